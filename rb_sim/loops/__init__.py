"""What does not depend on the scene, compiled once for all of them: it calls laws by address."""
