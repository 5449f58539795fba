"""Many runs of one scene: plans, the scheduler, the table of runs and what it says."""

from rb_sim.sweeps.plan import load_plan
from rb_sim.sweeps.sweep import SweepResult, sweep

__all__ = ["SweepResult", "load_plan", "sweep"]
