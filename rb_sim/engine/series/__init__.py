"""The systems that have a Taylor series: one line each."""

from rb_sim.engine.series import fixed_axis as fixed_axis
from rb_sim.engine.series import rolling_disk as rolling_disk
from rb_sim.engine.series import rolling_sphere as rolling_sphere
from rb_sim.engine.series import rotation as rotation
