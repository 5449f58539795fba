# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The table of common errors and notes for docs/reference/messages.md: text, cause, cure.

The text is a piece of the message as it stands in the sources; a test looks it up there. Accuracy
checks are listed where they are defined (rb_sim/base/errors.py).
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import NamedTuple

from rb_sim.accuracy.checks.check_list import CHECKS
from rb_sim.base.errors import CHECKS as WORDS

ROOT = Path(__file__).parents[1] / "rb_sim"


class Message(NamedTuple):
    """What a user reads, why, and what to do."""

    text: str
    cause: str
    cure: str


SCENES = (
    Message("unknown key", "a key is misspelt or stands in the wrong section",
            "the name that the message suggests; every key: [Scene schema](scene.md)"),
    Message("is missing", "a required key is absent", "add it"),
    Message("is not YAML: ", "indentation, a tab, or a missing bracket or quote",
            "correct the line and column that are named"),
    Message("a mapping {type: NAME, KEY: ...}",
            "a number or a word in place of a law, a shape or a surface",
            "a mapping, for example `friction: {type: coulomb, static: 0.5}`"),
    Message("listed under ",
            "a constraint stands under `effects`, or an effect under `constraints`",
            "move the entry to the section that is named"),
    Message("omitted: leave out a body that never moves", "a body is marked as fixed or static",
            "no body: a constraint without `parent` is to the world; or a `weld`"),
    Message("is for rb_sim statics only", "the bodies of the scene have no mass",
            "`rb_sim statics SCENE`, or a mass for each body"),
    Message("is given twice", "two entries have the same name", "rename one"),
    Message("an angle in radians, at most", "the angle is in degrees", "`angle: 90 deg`"),
    Message("since the order is [x, y, z, w]",
            "the quaternion was written in the order [w, x, y, z]", "[0, 0, 0, 1] for no rotation"),
    Message("is scaled to 1", "a quaternion whose length is not 1",
            "write `{axis: [x, y, z], angle: 30 deg}`, or more digits"),
    Message("denser than any solid", "a mass in grams", "kg and m"),
    Message("kg m^2 is more than", "an inertia in g cm^2, or larger than the shape allows",
            "kg m^2, or leave it out for that of the shape"),
    Message("is a ratio of forces", "a friction coefficient in degrees, or a large one for no slip",
            "tan of the angle, or `friction: {type: rough}`"),
    Message("does nothing:", "an effect whose forces are all zero", "give a force, or remove it"),
    Message("points out of the planes of all", "gravity upwards", "`acceleration: [0, 0, -9.81]`"),
    Message("lighter than any solid", "lengths in millimetres", "kg and m"),
    Message("the harmonic part is zero", "a `wrench` with `sine_force`, without its frequency",
            "`angular_frequency: 6.28`"),
    Message("nothing moves: ", "no effect, no velocity and no drive",
            "`effects: {weight: {type: gravity}}`"),
    Message("given unless the body has a shape", "a body needs an inertia",
            "`inertia: [Ixx, Iyy, Izz]`, or a `shape` of uniform density"),
    Message("an inertia that some body can have",
            "one principal moment exceeds the sum of the others",
            "check units and axes of the inertia; it is about the centre of mass"),
    Message("the centre of the shape, ", "a shape off the centre of mass has no known inertia",
            "`shape.center_B`, or give `inertia`"),
    Message("violates it by ", "the initial pose or velocity does not satisfy the constraint",
            "the values that are named, or `simulation.project_initial: true`"),
    Message("at the start", "bodies overlap, a bilateral contact is open, or a string is too short",
            "the position that the message names, or `simulation.project_initial: true`"),
    Message("slips at ", "the contact point of a `rough` contact moves at the start",
            "a rolling velocity, for example `v = w r`, or coulomb friction"),
    Message("they contradict each other", "no state satisfies all constraints",
            "remove one, or correct lengths and points"),
    Message("singular initial position", "the linkage starts at a dead centre",
            "start in another position"),
    Message("differ too much for double precision", "a mass ratio above about 1e10",
            "a heavier light body, or remove it"),
    Message("the only one for a contact `between`", "`between` needs time stepping",
            "`method: time_stepping`, or one contact for each pair"),
    Message("omitted if tolerance is given", "both `step` and `tolerance` are given", "remove one"),
)  # fmt: skip

RUNS = (
    Message("is too large for ", "the motion is faster than the fixed step resolves",
            "the step that the message names, or `--method dopri853 --tolerance 1e-10`"),
    Message("no step is small enough at t", "a force or speed grows without bound",
            "check springs at zero length, drag, and the scene at that time"),
    Message("the motion has no Taylor series at t", "the equations are not smooth there",
            "`--method dopri853`"),
    Message("singular configuration at t", "constraints lose rank: the motion beyond is not unique",
            "end the run before, or change lengths or drives"),
    Message("the body passed the end of its guide", "the guide is an open curve",
            "longer guide, shorter run, or a closed curve"),
    Message("reaches the edge of its surface", "a bilateral contact left its face",
            "a larger surface, or `mode: unilateral`"),
    Message("Painleve's paradox at t", "rigid contact with large friction has no solution",
            "less friction, or a compliant support"),
    Message("use simulation.method time_stepping for this scene",
            "too many or too close contact events", "`--method time_stepping --step 1e-3`"),
    Message("would have to pull or to slip", "a `rough` contact cannot hold",
            "`friction: {type: coulomb, static: 0.5}`, or `mode: bilateral`"),
    Message("lies flat at t", "a disk falls onto its face", "`lies_flat: true` for this contact"),
    Message("only its corners and ends make contact here", "an edge meets a narrow support",
            "list points along the edge"),
    Message("the motion no longer advances", "steps became too short to go on",
            "larger tolerance, or `--method radau5` for stiff springs"),
    Message("more at this pace", "the run takes more than ten minutes",
            "a larger step or tolerance, or a shorter duration"),
    Message("of wall-clock time: ", "`--max-wall` was reached", "raise it"),
    Message("; use another folder, ",
            "DIR contains a run", "another folder, or `--overwrite`"),
    Message("is not installed",
            "an optional package is missing", "the `pip install` that is named"),
    Message("disk full", "the disk of a log is full", "`rb_sim recover` for the bag"),
)  # fmt: skip

BAGS = (
    Message("not a bag: no ", "the folder has no .mcap or .db3 file",
            "give the folder of the bag or of the run"),
    Message("not recorded by rb_sim", "`resim` and `replay --publish` need the scene in the bag",
            "`ros2 bag play`, or `rb_sim analyze --masses SCENE`"),
    Message("unfinished; first run: rb_sim recover",
            "the recorder was killed", "`rb_sim recover BAG`"),
    Message("its checksum is wrong", "part of the file is damaged",
            "the rest is read; `rb_sim recover BAG` writes a readable bag"),
    Message("samples skipped (gap, impact or reset in B)", "B cannot be interpolated there",
            "nothing; the count tells how much was compared"),
    Message("residuals are correlated", "the model of the fit does not match the recording",
            "another scene, or other free parameters"),
    Message("peak acceleration uncertain by", "peaks shorter than the filter",
            "a higher sample rate"),
    Message("acceleration from poses is mostly noise", "noisy poses or stamps, or a low rate",
            "a better recording; use velocities and energies instead"),
    Message("poses skipped: stamps do not increase", "duplicate or reordered messages",
            "sort the bag (`mcap sort`)"),
    Message("stamps of different clocks", "the header stamps of topics have an offset",
            "synchronise the clocks before recording"),
    Message("its poses are in the frame", "the frame of the poses moves",
            "record the transform to a fixed frame"),
)  # fmt: skip

NODE = (
    Message("the node needs rclpy", "ROS 2 is not sourced",
            "`source /opt/ros/jazzy/setup.bash`, or `pip install 'rb_sim[ros]'`"),
    Message("runs already: rename this one", "two nodes of one name in the same domain",
            "`-r __node:=NAME`, or another ROS_DOMAIN_ID"),
    Message("unknown parameters: ", "a parameter is misspelt", "`rb_sim_node --help` lists all"),
    Message("refused: only while paused", "`~/step` needs a paused node",
            "call `~/pause` with true first"),
    Message("refused: still compiling", "the scene is not compiled yet", "wait for `~/state`"),
    Message(" is neither ", "a command in an unknown frame",
            "`frame_id: world`, or the name of the body"),
    Message("a component is not a finite number", "a command with NaN or infinity",
            "correct the controller"),
    Message("another node publishes ", "two nodes publish /clock", "`publish_clock:=false` on one"),
)  # fmt: skip

SECTIONS = {"Scenes": SCENES, "Runs": RUNS, "Bags and fits": BAGS, "The node": NODE}


def page(made: str) -> str:
    """Every accuracy check and the common errors, each with cause and cure."""
    parts = [
        "# Messages",
        f"{made} An error is one line on standard error, `error: FILE: KEY: got VALUE; must be "
        "...`, and ends the command ([exit codes](../cli.md#when-something-goes-wrong)). A warning "
        "is one line, and the command goes on. Search this page for a few words of a message.",
        "## Accuracy checks",
        "A warning reads `CHECK: QUANTITY is VALUE (limit LIMIT) at t = T s (BODY); ADVICE`. Each "
        "check warns once a run, at the first sample beyond its limit. With `--strict` the exit "
        "code is 3. How they work: [Accuracy checks](../accuracy-checks.md).",
    ]
    rows = ["| check | quantity | limit | cause | cure |", "|---|---|---|---|---|"]
    rows += [f"| {name} | {' | '.join(check)} |" for name, check in WORDS.items()]
    parts.append("\n".join(rows))
    for title, messages in SECTIONS.items():
        rows = ["| message contains | cause | cure |", "|---|---|---|"]
        for text, cause, cure in messages:
            rows.append(f"| {text.strip()} | {cause} | {cure} |")
        parts += [f"## {title}", "\n".join(rows)]
    return "\n\n".join(parts) + "\n"


def texts() -> list[str]:
    """Every text in the sources but docstrings; of an f-string as it is written."""
    found = []
    for path in ROOT.rglob("*.py"):
        source = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
            elif isinstance(node, ast.JoinedStr):
                found.append(ast.unparse(node))
    return found


def checks_that_are_named() -> set[str]:
    """Names of all checks: those of the list, and first arguments of other findings in
    rb_sim/accuracy/checks, as they stand in the sources."""
    names = {name for names, _ in CHECKS for name in names}
    for path in (ROOT / "accuracy" / "checks").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                if node.func.id == "Finding" and node.args:
                    first = ast.walk(node.args[0])
                    names |= {str(n.value) for n in first if isinstance(n, ast.Constant)}
    return names
