"""What accuracy costs: work-precision ladders, checked references, and the choice of a method."""
