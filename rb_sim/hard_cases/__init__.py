"""Hard cases in the open: scenes that engines get wrong, each with what must hold and why."""
