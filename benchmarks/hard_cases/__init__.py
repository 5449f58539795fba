"""The hard cases on other engines, as far as they can express them."""
