"""Time stepping of bodies in contact: tables of the scene, their geometry, the step, the motion."""
