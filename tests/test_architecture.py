# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What keeps the house honest: absent things are not in the machine code, steps do not allocate."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import textwrap
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from rb_sim.compiler.builder import INTEGER, REAL
from rb_sim.compiler.unit import Unit
from rb_sim.integrate.loop import record_into
from rb_sim.integrate.methods.dopri853 import dopri853
from rb_sim.integrate.methods.euler import euler
from rb_sim.integrate.methods.gauss6 import gauss6
from rb_sim.integrate.methods.radau5 import radau5
from rb_sim.integrate.methods.rk4 import rk4
from rb_sim.numerics.kernels import LOOP, STEP

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "rb_sim"

SCENES = """
import json, sys
import numpy as np
from benchmarks.pay_for_use import listings, mnemonics
from rb_sim.numerics.kernels import on_compilation
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.load import scene_from_mapping
from rb_sim.motion.traced import TracedMotion

NUT = {"mass": 1.0, "inertia": [1.0, 2.0, 3.0], "angular_velocity": [0.01, 2.0, 0.01]}
FREE = {
    "bodies": {"nut": NUT},
    "simulation": {"duration": 20.0, "method": "rk4", "step": 1e-3},
}

def motion_of(mapping, system=None):
    scene = scene_from_mapping(mapping)
    compiled = compile_scene(scene)
    if system is not None:
        from dataclasses import replace
        compiled = replace(compiled, system=system(compiled.system))
    motion = TracedMotion(compiled, compile_method(scene.simulation, scene.simulation.duration))
    motion.warm()
    return motion

def counts(mapping, system=None):
    with listings() as laws:
        motion_of(mapping, system)
    return mnemonics(laws)
"""

BARE = """
# Newton and Euler for one free body, with nothing around them: the least that a step can be.
from typing import NamedTuple
from rb_sim.catalogue.spec import BodyState
from rb_sim.mechanics.systems.one_body import put_balance, put_state, quaternion_defect
from rb_sim.mechanics.systems.one_body import Dynamics, body_system
from rb_sim.mechanics.system import project, sample
from rb_sim.mechanics.systems.free import on_polhode, unit_if_needed
from rb_sim.mechanics.systems.many_bodies import state_of
from rb_sim.numerics.vectors import conjugate, quaternion_product, quaternion_rate, rotate, scale

class Bare(NamedTuple):
    body: object
    q_BP: tuple
    moments: tuple
    coupling: tuple
    weights: tuple
    contrast: tuple
    polhode: tuple
    effects: tuple

NONE = (0.0, 0.0, 0.0)

@body_system(Bare, configuration=7)
def bare_dynamics(system, t, y):
    P, k = state_of(y, 0), system.coupling
    a, w = scale(1.0 / system.body.mass, NONE), P.w_WB_B
    alpha = (k[0] * (w[1] * w[2]), k[1] * (w[2] * w[0]), k[2] * (w[0] * w[1]))
    rates = P.v_WC + quaternion_rate(P.q_WB, w) + a + alpha
    return Dynamics(rates, P, quaternion_defect(P.q_WB))

@project.register(Bare)
def bare_project(system, t, y):
    return y[0:3] + unit_if_needed(y[3:7]) + y[7:10] + on_polhode(system, y[10:13])

@sample.register(Bare)
def bare_sample(system, t, y, out):
    P = state_of(y, 0)
    q_WB = quaternion_product(P.q_WB, conjugate(system.q_BP))
    B = BodyState(P.p_WC, q_WB, P.v_WC, rotate(system.q_BP, P.w_WB_B))
    i = put_state(out, B)
    put_balance(out, i, system.effects, t, system.body, B, quaternion_defect(P.q_WB))
"""


def run_python(code: str, cache: Path, **environment: str) -> str:
    """Output of a new interpreter that compiles into `cache`."""
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    variables = {
        **os.environ,
        "RB_SIM_CACHE": str(cache),
        "PYTHONPATH": os.pathsep.join(path for path in paths if path),
        **environment,
    }
    done = subprocess.run(
        [sys.executable, "-c", SCENES + textwrap.dedent(code)],
        env=variables,
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def shipped_code(tmp_path_factory: pytest.TempPathFactory) -> dict[str, int]:
    """Machine instructions of the free body's laws beside the whole catalogue."""
    code = "print(json.dumps(counts(FREE)))"
    return json.loads(run_python(code, tmp_path_factory.mktemp("shipped")))


def branches(code: dict[str, int]) -> int:
    """Conditional jumps (x86 and ARM)."""
    words = ("b.", "cbz", "cbnz", "tbz", "tbnz")
    return sum(
        count
        for word, count in code.items()
        if word.startswith(words) or (word.startswith("j") and word != "jmp")
    )


@pytest.mark.slow
@pytest.mark.parametrize("kinds", [1, 50])
def test_a_free_body_compiles_to_the_same_code_in_any_catalogue(
    kinds: int, shipped_code: dict[str, int], tmp_path: Path
) -> None:
    code = f"""
    from benchmarks.pay_for_use import add_synthetic, strip
    from rb_sim.catalogue.effects import SPECS
    shipped = len(SPECS)
    strip({kinds})
    add_synthetic({kinds} - shipped)
    print(json.dumps(counts(FREE)))
    """
    assert json.loads(run_python(code, tmp_path)) == shipped_code


@pytest.mark.slow
def test_a_free_body_takes_no_more_branches_than_the_bare_equations(
    shipped_code: dict[str, int], tmp_path: Path
) -> None:
    """Whoever tests in a step whether an absent effect acts, or walks a table, adds a branch. How
    often a number goes to memory and back is the compiler's choice for each processor: 2.2 %
    more on one of them."""
    code = BARE + "\nprint(json.dumps(counts(FREE, lambda s: Bare(*s))))"
    bare = json.loads(run_python(code, tmp_path))
    assert branches(shipped_code) == branches(bare)
    assert sum(shipped_code.values()) <= 1.05 * sum(bare.values())


def test_the_number_of_steps_allocates_nothing() -> None:
    """No loop, and no step of a method, takes memory."""
    unit = Unit()
    unit.for_c(record_into.function, LOOP, INTEGER, "loop")
    for step in (euler, rk4, dopri853, gauss6, radau5):
        unit.for_c(step.function, STEP, REAL, step.function.__name__)
    assert "dopri853" in unit.text() and "find_stages" in unit.text()
    assert "call ptr @obtain" not in unit.text()


def test_a_second_process_compiles_nothing_and_plain_python_gives_the_same(tmp_path: Path) -> None:
    """Nor does it load what only compiling needs. Loops are shipped: only laws are compiled."""
    code = """
    compiled = []
    with listings() as laws, on_compilation(lambda: compiled.append(True)):
        motion = motion_of(FREE)
    out = np.zeros((3, motion.width))
    motion.run_to([0.0, 0.0105, 0.02], out)
    heavy = ("numba", "rb_sim.compiler.unit", "scipy.linalg")
    set_up = [name for name in heavy if name in sys.modules]
    seen = {"laws": len(laws), "compiled": len(compiled), "set up": set_up, "rows": out.tolist()}
    print(json.dumps(seen))
    """
    first = json.loads(run_python(code, tmp_path))
    second = json.loads(run_python(code, tmp_path))
    plain = json.loads(run_python(code, tmp_path, RB_SIM_INTERPRETED="1"))
    assert first["laws"] > 0
    assert (second["laws"], second["compiled"], second["set up"]) == (0, 0, [])
    assert second["rows"] == first["rows"]
    for row, other in zip(first["rows"], plain["rows"], strict=True):
        # the compiler may contract a multiplication and an addition into one rounding
        assert row == pytest.approx(other, rel=1e-14, abs=1e-15)


def contracts() -> list[dict[str, Any]]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return project["tool"]["importlinter"]["contracts"]


def test_the_import_contract_names_every_package() -> None:
    layers = contracts()[0]["layers"]
    named = {name for layer in layers for name in re.split(r"[\s:|]+", layer)}
    assert len(layers) <= 10
    packages = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert {f"rb_sim.{name}" for name in packages} == named


def test_no_module_lies_beside_the_packages() -> None:
    assert {path.name for path in PACKAGE.glob("*.py")} == {"__init__.py", "__main__.py"}


def sources_of_the_package() -> dict[str, Path]:
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in PACKAGE.rglob("*.py")
    }


def test_a_module_name_means_one_thing() -> None:
    """But for verbs of the command line, called as what they show, and the entry points."""
    places: dict[str, list[str]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.stem not in ("__init__", "__main__", "main") and path.parent.name != "verbs":
            places.setdefault(path.stem, []).append(str(path.relative_to(PACKAGE)))
    assert [found for found in places.values() if len(found) > 1] == []


def test_no_module_imports_itself_by_way_of_others() -> None:
    """Neither when it is loaded nor by an import inside a function, or for types alone."""
    sources = sources_of_the_package()
    imports = {name: named_in(path, sources) - {name} for name, path in sources.items()}
    del imports["rb_sim"]  # its names load when they are first used
    while free := {name for name, needs in imports.items() if not needs & imports.keys()}:
        imports = {name: needs for name, needs in imports.items() if name not in free}
    assert not imports, sorted(imports)


def test_every_module_of_ours_that_benchmarks_and_tests_import_exists() -> None:
    """In an import inside a function too. Names inside modules are left to pyrefly."""
    ours = ("rb_sim", "benchmarks", "tests", "tools")
    missing = [
        f"{source.relative_to(ROOT)}: {module}"
        for folder in ("benchmarks", "tests")
        for source in (ROOT / folder).rglob("*.py")
        for module, _ in named_by(ast.walk(ast.parse(source.read_text(encoding="utf-8"))))
        if module.split(".")[0] in ours
        and not (place := ROOT.joinpath(*module.split("."))).is_dir()
        and not place.with_suffix(".py").is_file()
    ]
    assert not missing


def named_in(source: Path, modules: Mapping[str, Path]) -> set[str]:
    """Which of the modules a file names in its imports, wherever they stand."""
    found: set[str] = set()
    tree = ast.parse(source.read_text(encoding="utf-8"))
    for module, inside in named_by(ast.walk(tree)):
        found |= inside & modules.keys() or {module}
    return found & modules.keys()


def named_by(nodes: Iterable[ast.AST]) -> Iterator[tuple[str, set[str]]]:
    """Each module that an import among the nodes names, and what it takes out of it."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from ((alias.name, set()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module, {f"{node.module}.{alias.name}" for alias in node.names}


def test_what_is_off_is_not_even_called(tmp_path: Path) -> None:
    """A run without sinks, ROS, contacts or watches makes no call into them: they cost exactly
    nothing."""
    code = """
    import threading
    from rb_sim import Simulation
    simulation = Simulation(scene_from_mapping(FREE))
    simulation.warm()
    homes = set()
    def note(frame, event, argument):
        if event == "call":
            homes.add(frame.f_code.co_filename)
    sys.setprofile(note)
    simulation.run(1.0, 100.0, checks=False)
    sys.setprofile(None)
    print(json.dumps(sorted(homes)))
    """
    called = json.loads(run_python(code, tmp_path))
    assert any(name.endswith("rb_sim/motion/traced.py") for name in called)  # the watch works
    absent = r"/rb_sim/(io/|ros/|contact/|accuracy/(?!checks/)|accuracy/checks/check_list)"
    assert [name for name in called if re.search(absent, name)] == []


def test_a_body_without_contacts_loads_none_of_what_contacts_need(tmp_path: Path) -> None:
    code = """
    from rb_sim import Simulation
    Simulation(FREE).advance(0.01)
    heavy = ("rb_sim.contact.events", "rb_sim.contact.stepping", "scipy.spatial", "scipy.linalg")
    print(json.dumps([name for name in sys.modules if name.startswith(heavy)]))
    """
    assert json.loads(run_python(code, tmp_path, RB_SIM_INTERPRETED="1")) == []
