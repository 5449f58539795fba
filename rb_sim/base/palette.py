# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The colours of all pictures: plots, reports, Rerun, documentation.

Colours of Okabe and Ito (Color Universal Design, 2008), distinguishable with any colour vision, on
white and on Rerun's dark background. A quantity, a method or an engine has one colour everywhere.
"""

from __future__ import annotations

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILLION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
BROWN, GREY = "#7F5539", "#6B6B6B"
"""Further colours: Okabe and Ito's yellow is too pale for a line on white."""

TEXT, FAINT, GRID = "#333333", "#666666", "#DDDDDD"
"""Text, secondary text, grid lines."""

AXES = (VERMILLION, GREEN, BLUE, GREY)
"""Colours of x, y, z and the scalar part w, and of roll, pitch, yaw (without w)."""

MOTIONS = {"A": BLUE, "B": ORANGE}
"""Colours of two motions in comparison."""

ENERGIES = {"kinetic": VERMILLION, "potential": BLUE, "total": BLACK, "work": ORANGE}

VELOCITY, REACTION, TENSION, COMMAND, EVENT = SKY, ORANGE, BLUE, PURPLE, PURPLE
"""Colours of arrows and marks."""

SLIPPING, STICKING = ORANGE, BLUE
"""Colours of contact points."""

GOOD, NARROW, BAD = BLUE, ORANGE, VERMILLION
"""Colours of a bound with a wide margin, with a narrow margin, and exceeded."""

CYCLE = (BLUE, ORANGE, GREEN, PURPLE, VERMILLION, SKY, BROWN, GREY)
"""Colours of curves without their own: bodies, topics, sources."""

METHODS = {
    "euler": PURPLE,
    "rk4": ORANGE,
    "dopri853": BLUE,
    "gauss6": GREEN,
    "radau5": VERMILLION,
    "taylor": SKY,
    "time_stepping": BROWN,
}
"""Colours of integration methods; GREY for others."""

ENGINES = {
    "rb_sim": BLACK,
    "mujoco": VERMILLION,
    "drake": BLUE,
    "exudyn": GREEN,
    "pybullet": PURPLE,
    "dartpy": BROWN,
    "pinocchio": SKY,
    "scipy": GREY,
    "heyoka": ORANGE,
}
"""Colours of the programs that benchmarks compare."""


def of_method(name: str) -> str:
    """The colour of a method in any form: "dopri853 adaptive" has that of dopri853."""
    return METHODS.get(name.split()[0], GREY)


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue from 0 to 255, as Rerun takes them."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
