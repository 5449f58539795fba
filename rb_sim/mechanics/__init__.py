"""The equations of motion of a compiled scene: coordinates, laws, multipliers and samples."""
