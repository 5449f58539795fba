"""A picture that is drawn again has the numbers of the table."""

from __future__ import annotations

from benchmarks.peers.redraw import entry

TEXT = """
## rod

| error <= | best engine | mujoco | scipy | rb_sim | by | engine/rb_sim |
|---|---|---|---|---|---|---|
| 1e-01 | mujoco 1 | 7.3e-03 | 2e-4 | 6e-06 | auto | 2 |
| 1e-02 | none | - | 3e-4 | 7e-06 | auto | - |

## next
"""


def test_the_numbers_are_those_of_the_table():
    engines = entry(TEXT, "rod")["engines"]
    assert list(engines) == ["mujoco", "scipy", "rb_sim"]
    assert engines["mujoco"]["points"] == [{"error": 0.1, "cost": 7.3e-3}]
    assert engines["rb_sim"]["points"][1] == {"error": 0.01, "cost": 7e-6}
