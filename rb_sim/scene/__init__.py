"""From a scene file to the compiled system: reading, checking, compiling, the initial state."""
