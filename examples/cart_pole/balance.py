# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A controller outside of the simulator that keeps the pole of cart_pole.yaml up.

    rb_sim_node examples/cart_pole/cart_pole.yaml --ros-args -p start_paused:=true -p out:=out/pole
    python examples/cart_pole/balance.py               # in lockstep, by ~/advance
    python examples/cart_pole/balance.py --topics      # in real time, by pose, twist and wrench

The gain is that of a discrete linear-quadratic regulator, from the model that `rb_sim linearize`
prints. A push disturbs the pole first, so that there is something to do.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from rclpy.utilities import try_shutdown
from scipy.linalg import solve_discrete_are
from scipy.signal import cont2discrete
from std_srvs.srv import SetBool

import rb_sim
from rb_sim.ros.build_interfaces import need

SCENE = Path(__file__).with_name("cart_pole.yaml")
RATE = 100.0
"""[Hz], as the scene's."""
MEASURED = ("cart/position_x", "pole/angle_y", "cart/velocity_x", "pole/spin_y")
"""[m], [rad], [m/s], [rad/s]."""
WEIGHTS, EFFORT = (10.0, 10.0, 1.0, 1.0), 0.1
"""On the squares of what is measured, and on that of the force."""
PUSH, PUSHED = 5.0, 0.1
"""Force [N] on the cart, and until when [s]."""
PATIENCE = 60.0
"""[s] of wall time for the node to be there, and for each answer."""


def lqr_gain() -> np.ndarray:
    """The gain K of force = -K measured, shape (4,); the pole upright is the origin."""
    model = rb_sim.Simulation(SCENE).linearize()
    B = model.B[:, [model.inputs.index("cart/force_x")]]
    C = model.C[[model.outputs.index(name) for name in MEASURED]]
    discrete: Any = cont2discrete((model.A, B, C, np.zeros((4, 1))), 1.0 / RATE)
    A, B, *_ = discrete
    Q, R = C.T @ np.diag(WEIGHTS) @ C, np.array([[EFFORT]])
    P = solve_discrete_are(A, B, Q, R)
    return (np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A) @ np.linalg.inv(C))[0]


def measured(cart: Any, pole: Any, cart_twist: Any, pole_twist: Any) -> np.ndarray:
    """MEASURED, from the poses and twists of messages."""
    angle = 2.0 * math.atan2(pole.orientation.y, pole.orientation.w)
    return np.array([cart.position.x, angle, cart_twist.linear.x, pole_twist.angular.y])


def force(gain: np.ndarray, t: float, state: np.ndarray) -> float:
    """What the cart is commanded at simulated time t [N]."""
    return PUSH if t < PUSHED - 0.5 / RATE else -float(gain @ state)


def lockstep(node: Node, gain: np.ndarray, seconds: float) -> np.ndarray:
    """Balance by ~/advance: between two requests nothing moves. What was measured, shape (n, 4)."""
    try:
        need("rb_sim_interfaces")
    except rb_sim.RbSimError as error:
        raise SystemExit(f"no lockstep: {error}") from None
    from rb_sim_interfaces.msg import BodyWrench
    from rb_sim_interfaces.srv import Advance

    service = node.create_client(Advance, "/rb_sim/advance")
    if not service.wait_for_service(PATIENCE):
        raise SystemExit("no service /rb_sim/advance: does the node run, and paused?")
    request, states = Advance.Request(samples=0), []
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    for k in range(round(seconds * RATE) + 1):
        answer = awaited(executor, service.call_async(request))
        if answer is None or not answer.success:
            raise SystemExit(f"not advanced: {answer.message if answer else 'no answer'}")
        body = {state.body: state for state in answer.bodies}
        cart, pole = body["cart"], body["pole"]
        states.append(measured(cart.pose, pole.pose, cart.twist, pole.twist))
        wrench = BodyWrench(body="cart", frame_id="world")
        wrench.wrench.force.x = force(gain, k / RATE, states[-1])
        request = Advance.Request(samples=1, wrenches=[wrench])
    return np.array(states)


def awaited(executor: Executor, future: Future) -> Any:
    """Its result; None where none came.

    rclpy's `spin_until_future_complete` waits, too, but leaves something behind each time: after
    200 calls one costs ten times as much as the first.
    """
    end = time.monotonic() + PATIENCE
    while not future.done() and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    return future.result()


def topics(node: Node, gain: np.ndarray, seconds: float) -> np.ndarray:
    """Balance by topics, while the node runs in real time. What was measured, shape (n, 4)."""
    last: dict[str, Any] = {}
    states: list[np.ndarray] = []
    begun: list[float] = []
    commands = node.create_publisher(WrenchStamped, "/rb_sim/cart/wrench", 1)

    def note(topic: str, message: Any) -> None:
        last[topic] = message
        stamps = {(m.header.stamp.sec, m.header.stamp.nanosec) for m in last.values()}
        if len(last) < 4 or len(stamps) > 1:  # the rest of this sample is on its way
            return
        t = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        begun.append(t)
        poses = last["cart/pose"].pose, last["pole/pose"].pose
        states.append(measured(*poses, last["cart/twist"].twist, last["pole/twist"].twist))
        command = WrenchStamped()
        command.header.frame_id = "world"
        command.wrench.force.x = force(gain, t - begun[0], states[-1])
        commands.publish(command)

    for body in ("cart", "pole"):
        for kind, name in ((PoseStamped, "pose"), (TwistStamped, "twist")):
            topic = f"{body}/{name}"

            def hear(message: Any, topic: str = topic) -> None:
                note(topic, message)

            node.create_subscription(kind, f"/rb_sim/{topic}", hear, 10)
    pause = node.create_client(SetBool, "/rb_sim/pause")
    if not pause.wait_for_service(PATIENCE):
        raise SystemExit("no service /rb_sim/pause: does the node run?")
    while commands.get_subscription_count() == 0:
        rclpy.spin_once(node, timeout_sec=0.1)
    pause.call_async(SetBool.Request(data=False))
    while len(states) < seconds * RATE:
        rclpy.spin_once(node, timeout_sec=0.1)
    return np.array(states)


def main() -> None:
    """Balance for --seconds of simulated time and say how well."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--topics", action="store_true", help="in real time, not in lockstep")
    parser.add_argument("--seconds", type=float, default=8.0, help="of simulated time")
    parser.add_argument("--save", type=Path, help="file.npy for what was measured, shape (n, 4)")
    given = parser.parse_args()
    gain = lqr_gain()
    rclpy.init()
    node = Node("balance")
    try:
        states = (topics if given.topics else lockstep)(node, gain, given.seconds)
    finally:
        node.destroy_node()
        try_shutdown()
    worst, end = np.degrees(np.max(np.abs(states[:, 1]))), np.degrees(abs(states[-1, 1]))
    if given.save is not None:
        np.save(given.save, states)
    print(f"gain {np.round(gain, 4).tolist()}")
    print(f"largest angle {worst:.3f} deg, at the end {end:.2e} deg, x = {states[-1, 0]:.2e} m")


if __name__ == "__main__":
    main()
