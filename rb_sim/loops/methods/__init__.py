"""Steps of the methods, one file each."""
