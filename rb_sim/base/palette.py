# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The colours of all pictures: plots, reports, Rerun, documentation.

Okabe and Ito's colours (Color Universal Design, 2008), which differ with any colour vision, on a
white ground as on Rerun's dark one. A quantity, a method and an engine have one colour everywhere.
"""

from __future__ import annotations

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILLION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
BROWN, GREY = "#7F5539", "#6B6B6B"
"""Not Okabe and Ito's, whose yellow is too pale for a line on white."""

TEXT, FAINT, GRID = "#333333", "#666666", "#DDDDDD"
"""Words, words of less weight, grid lines."""

AXES = (VERMILLION, GREEN, BLUE, GREY)
"""Of x, y, z and the scalar part w, and of roll, pitch, yaw (without w)."""

MOTIONS = {"A": BLUE, "B": ORANGE}
"""Of two motions beside each other."""

ENERGIES = {"kinetic": VERMILLION, "potential": BLUE, "total": BLACK, "work": ORANGE}

VELOCITY, REACTION, TENSION, COMMAND, EVENT = SKY, ORANGE, BLUE, PURPLE, PURPLE
"""Of arrows and marks."""

SLIPPING, STICKING = ORANGE, BLUE
"""Of points of contact."""

GOOD, NARROW, BAD = BLUE, ORANGE, VERMILLION
"""Of what holds with a wide margin, with a narrow one, and not."""

CYCLE = (BLUE, ORANGE, GREEN, PURPLE, VERMILLION, SKY, BROWN, GREY)
"""Of curves that have no colour of their own: bodies, topics, sources."""

METHODS = {
    "euler": PURPLE,
    "rk4": ORANGE,
    "dopri853": BLUE,
    "gauss6": GREEN,
    "radau5": VERMILLION,
    "taylor": SKY,
    "time_stepping": BROWN,
}
"""Of integration methods, by name; one that is not listed has GREY."""

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
"""Of the programs that benchmarks compare."""


def of_method(name: str) -> str:
    """The colour of a method, whatever its form: "dopri853 adaptive" has that of dopri853."""
    return METHODS.get(name.split()[0], GREY)


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue from 0 to 255, as Rerun takes them."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
