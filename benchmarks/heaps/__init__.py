"""Many bodies on each other: how fast heaps step, and that they stand, beside other engines."""
