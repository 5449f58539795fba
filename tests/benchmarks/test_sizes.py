"""The scenes of `benchmarks.sizes` can be read, and its rows say what was measured."""

from benchmarks.sizes import cases, line, written
from rb_sim import load_scene


def test_every_case_is_a_scene(tmp_path):
    found = {name: load_scene(written(scene, tmp_path, name)) for name, scene in cases(10).items()}
    assert len(found["chain of 10"].bodies) == 10
    assert len(found["64 springs"].effects) == 64
    assert len(found["lattice 10 x 10"].effects) == 180


def test_a_row_names_what_could_not_be_measured():
    row = {
        "cold start": 1.0,
        "warm start": 0.5,
        "step": 2.0,
        "MuJoCo": None,
        "old": "RecursionError",
    }
    assert line("chain of 2", row).endswith("step 2 us, old RecursionError")
