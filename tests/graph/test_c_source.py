# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Laws printed in C and compiled by the machine's C compiler give the numbers of the traced law."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from rb_sim import RbSimError, load_scene
from rb_sim.mechanics.system import rate
from rb_sim.scene.compile import compile_scene
from tools.c_law import c_law

FLAGS = ("-std=c99", "-O2", "-shared", "-fPIC", "-ffp-contract=off", "-Wall", "-Werror")
DOUBLES = ctypes.POINTER(ctypes.c_double)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize(
    "scene", ["heavy_top", "pendulum", "free_tumble", "rolling_disk", "rolling_sphere"]
)
def test_c_gives_the_numbers_of_the_law(scene: str, tmp_path: Path) -> None:
    source, library = tmp_path / "law.c", tmp_path / "law.so"
    source.write_text(c_law(scene))
    subprocess.run(["cc", *FLAGS, str(source), "-o", str(library), "-lm"], check=True)
    printed = ctypes.CDLL(str(library)).rate
    compiled = compile_scene(load_scene(scene))
    y = np.array(compiled.y) + 0.01 * np.random.default_rng(1).normal(size=len(compiled.y))
    p, out = np.zeros(1), np.zeros(len(y))
    printed(ctypes.c_double(0.3), *(x.ctypes.data_as(DOUBLES) for x in (y, p, out)))
    expected = np.array(rate(compiled.system, 0.3, tuple(y.tolist())), float)
    np.testing.assert_allclose(out, expected, rtol=1e-14, atol=1e-14 * np.abs(expected).max())


def test_a_scene_that_is_no_single_law_is_refused() -> None:
    with pytest.raises(RbSimError, match="^bouncing_ball: must be of one body"):
        c_law("bouncing_ball")
