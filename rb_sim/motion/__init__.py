"""A compiled scene under one method, carried from instant to instant."""
