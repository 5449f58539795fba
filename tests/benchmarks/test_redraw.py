"""A picture that is drawn again has the numbers of the table."""

from __future__ import annotations

from benchmarks.peers.redraw import entry
from benchmarks.peers.report import markdown


def point(method: str, knob: float, error: float, cost: float) -> dict:
    return {"method": method, "knob": knob, "error": error, "cost": cost}


RESULTS = {
    "machine": {"versions": {}},
    "machine_line": "a machine",
    "skipped": [],
    "kinds": {"rb_sim": "rb_sim", "mujoco": "engine", "scipy": "equations"},
    "scenes": {
        "rod": {
            "engines": {
                "rb_sim": {
                    "notes": [],
                    "points": [point("rk4", 0.1, 0.09, 6e-6), point("auto", 1e-2, 1e-12, 7e-6)],
                },
                "mujoco": {"notes": [], "points": [point("RK4", 0.1, 0.05, 7.3e-3)]},
                "scipy": {"notes": [], "points": [point("DOP853", 1e-2, 5e-3, 2e-4)]},
            }
        }
    },
}


def test_the_numbers_are_those_of_the_table() -> None:
    engines = entry(markdown(RESULTS), "rod")["engines"]
    assert list(engines) == ["mujoco", "scipy", "rb_sim"]
    assert engines["mujoco"]["points"] == [{"error": 0.1, "cost": 7.3e-3}]
    assert [p["error"] for p in engines["scipy"]["points"]] == [0.1, 0.01]
    assert engines["rb_sim"]["points"][0] == {"error": 0.1, "cost": 6e-6}
    assert engines["rb_sim"]["points"][-1] == {"error": 1e-12, "cost": 7e-6}


def test_a_page_shows_costs_and_ways_in_tables_that_fit_on_it() -> None:
    lines = markdown(RESULTS).splitlines()
    assert "| 1e-01 | 7.3e-03 | 2.0e-04 | 6.0e-06 |" in lines
    assert "| 1e-01 | mujoco RK4 1e-01 | rk4 1e-01 | 1.2e+03 | - |" in lines
    assert "| 1e-02 | none | auto 1e-02 | - | - |" in lines
