"""Services that take interface packages which not every installation has."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rb_sim.ros import simulation_services
from rb_sim.ros.interfaces import is_there
from rb_sim.ros.lockstep import Lockstep
from rb_sim.ros.set_state import SetStateService

if TYPE_CHECKING:
    from rclpy.node import Node

    from rb_sim.ros.node import SimulationLoop
    from rb_sim.ros.stepper import Stepper
    from rb_sim.simulation import Simulation

OWN = "rb_sim_interfaces"


def offer_services(
    node: Node, loop: SimulationLoop, simulation: Simulation, stepper: Stepper, *, may_quit: bool
) -> None:
    """~/advance and ~/set_state, and those of simulation_interfaces, as far as there are types."""

    def own() -> None:
        Lockstep(node, loop, simulation, loop.commands, stepper)
        SetStateService(node, loop, simulation, stepper)

    def common() -> None:
        simulation_services.SimulationServices(node, loop, may_quit=may_quit)

    for package, offer in ((OWN, own), (simulation_services.PACKAGE, common)):
        if not is_there(package):
            continue
        try:
            offer()
        except Exception as error:  # what its compiled parts raise shares no base class
            words = " ".join(str(error).split()) or type(error).__name__
            node.get_logger().warning(
                f"no services of {package}: the package is there, but cannot be loaded: {words}"
            )
