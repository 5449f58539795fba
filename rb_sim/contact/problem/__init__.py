"""The contact problem at one instant: impulses of impacts, forces between them, and modes."""
