# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters: descriptors, start values, changes while running."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from rb_sim.ros.parameters import Settings, refusal

ROOT = Path(__file__).resolve().parents[2]


def test_the_shipped_file_names_every_parameter_with_its_default():
    document = yaml.safe_load((ROOT / "config" / "rb_sim_node.params.yaml").read_text())
    shipped = document["/**"]["ros__parameters"]
    defaults = {name: value for name, value in vars(Settings()).items() if name != "scene"}
    assert shipped == defaults
    assert {name: type(value) for name, value in shipped.items()} == {
        name: type(value) for name, value in defaults.items()
    }


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("rate", -1.0, "rate: got -1.0; must be within [0, 100000]"),
        ("rate", float("nan"), "rate: got nan; must be within"),
        ("step", float("inf"), "step: got inf; must be within"),
        ("tolerance", "fine", "tolerance: got 'fine'; must be of type float"),
        (
            "method",
            "leapfrog",
            "method: got 'leapfrog'; must be one of euler, rk4, dopri853, gauss6, radau5, taylor, "
            "time_stepping, auto",
        ),
        ("publish_depth", 1.5, "publish_depth: got 1.5; must be of type int"),
        ("publish_depth", 0, "publish_depth: got 0; must be within [1, 10000]"),
        ("frame_prefix", "/robot1/", "frame_prefix: got '/robot1/'; must not begin"),
        ("log_bag", 1, "log_bag: got 1; must be of type bool"),
    ],
)
def test_a_wrong_value_is_refused_with_the_reason(name, value, words):
    assert words in (refusal(name, value) or "")


@pytest.mark.parametrize(("name", "value"), [("duration", 5), ("rate", 50.0), ("method", "rk4")])
def test_a_right_value_is_accepted(name, value):
    assert refusal(name, value) is None


EACH_IN_TURN = """
import json, sys
from rclpy.utilities import try_shutdown
from rb_sim.ros import main
for arguments in json.loads(sys.argv[1]):
    status = main.main(arguments)
    try_shutdown()
    print(f"ended with {status}", file=sys.stderr, flush=True)
"""
POSE = "qos_overrides./rb_sim/ball/pose.publisher"
REFUSED: list[tuple[list[str] | dict[str, object], str]] = [
    ([], "'' is no scene file"),
    (["missing.yaml"], "missing.yaml"),
    (["--what"], "must be SCENE"),
    (["heavy_top", "bogus"], "got 'bogus'; must be SCENE"),
    (["heavy_top", "--ros-args", "-p", "rate=5"], "got '-p rate=5'; must be -p NAME:=VALUE"),
    (["a.yaml", "--ros-args", "--params-file", "missing"], "ROS refused to start"),
    ({"out": "x" * 300}, "parameter out: xxx"),
    ({"out": "file/out"}, "file/out/bag: cannot record here"),
    ({"rate": -5.0}, "parameter rate: got -5.0; must be within [0, 100000]"),
    ({"method": "euler", "tolerance": 1e-6}, "tolerance"),
    ({"imu": "moon"}, "parameter imu: got body 'moon'; must be one of ball"),
    ({"split_size": 5000, "out": "run"}, "split_size: got 5000; must be 0 (never) or at least"),
    ({f"{POSE}.reliability": "perhaps"}, "topic ~/ball/pose: its qos_overrides are refused: "),
    ({f"{POSE}.depth": 0}, "depth: got 0; must be 1 to 1000000"),
]
"""Arguments or parameters of a node of the sphere, and words of the line that refuses them."""


def test_a_wrong_start_is_one_line(sphere, tmp_path: Path):
    """All in one process, which takes as long to start as ten of them do."""
    (tmp_path / "file").write_text("")
    every = []
    for given, _ in REFUSED:
        if isinstance(given, dict):
            values = [word for name in given for word in ("-p", f"{name}:={given[name]}")]
            given = [str(sphere), "--ros-args", "-p", "discovery:=0.0", *values]
        every.append(given)
    command = [sys.executable, "-c", EACH_IN_TURN, json.dumps(every)]
    said = subprocess.run(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ).stdout
    *parts, rest = said.split("ended with 2\n")
    assert rest == "" and len(parts) == len(REFUSED), said
    for part, (_, words) in zip(parts, REFUSED, strict=True):
        (line,) = [line for line in part.splitlines() if "[INFO]" not in line]
        assert words in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


def test_parameters_that_the_node_does_not_have_are_named(sphere, start, tmp_path: Path):
    """A safety limit that is misspelt limits nothing, nor does that of a node of another name;
    those that it has go before the scene's."""
    files = {
        "robot": {"/robot": {"ros__parameters": {"max_force": 5.0}}},
        "inner": {"lab": {"rb_sim": {"ros__parameters": {"max_force": 5.0}}}},
        "ours": {"/robot": {"ros__parameters": {}}, "rb_sim": {"ros__parameters": {"rate": 250}}},
        "all": {"/**": {"ros__parameters": {"duration": 0.1}}},
    }
    ros: list[str] = ["-p", "rbsim:max_torque:=1.0", "-p", "rb_sim:method:=rk4"]
    ros += ["-p", "rb_sim:step:=0.001"]
    for name, content in files.items():
        (tmp_path / name).write_text(json.dumps(content))
        ros += ["--params-file", str(tmp_path / name)]
    misspelt = {"max_forse": 5.0, "joint_state": True, "qos_overrides./clokc.publisher.depth": 2}
    known = {"use_sim_time": False, "qos_overrides./clock.publisher.depth": 2}
    node = start(sphere, ros=tuple(ros), **misspelt, **known)
    assert node.wait() == 0
    assert f"{tmp_path / 'robot'}: sets parameters of /robot, none of /rb_sim" in node.text
    assert f"{tmp_path / 'inner'}: sets parameters of /lab/rb_sim, none of /rb_sim" in node.text
    assert "-p rbsim:max_torque: sets parameters of rbsim, none of /rb_sim" in node.text
    assert node.text.count("sets parameters of") == 3
    words = "joint_state (did you mean joint_states?), max_forse (did you mean max_force?);"
    assert node.text.count("unknown parameters") == 2, node.text
    assert words in node.text and "parameters: qos_overrides./clokc.publisher.depth;" in node.text
    assert "250 samples per second" in node.text
    assert "stopped at t = 0.1 s (duration over)" in node.text
