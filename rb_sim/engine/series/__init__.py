"""Series derived by hand, of systems where that is much cheaper than the series of their graph:
one line each."""

from rb_sim.engine.series import rolling_disk as rolling_disk
from rb_sim.engine.series import rolling_sphere as rolling_sphere
