"""Packages of services that are there and cannot be loaded."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import pytest

from rb_sim.ros.services import optional


@pytest.mark.parametrize(
    "broken, words",
    [
        ("raise OSError('libmsg.so: undefined symbol: x')", "undefined symbol: x"),
        ("raise ImportError('no types\\nin here')", "no types in here"),
        ("", "cannot import name"),
    ],
)
def test_a_package_that_cannot_be_loaded_is_one_line(broken, words, tmp_path, monkeypatch):
    package = tmp_path / "simulation_interfaces"
    package.mkdir()
    (package / "__init__.py").write_text(broken)
    monkeypatch.syspath_prepend(str(tmp_path))
    # what is imported here is gone afterwards, and one that was there before is there again
    monkeypatch.setitem(sys.modules, "simulation_interfaces", None)
    monkeypatch.delitem(sys.modules, "simulation_interfaces")
    monkeypatch.setattr(optional, "OWN", "not_installed_anywhere")
    said: list[str] = []
    node: Any = SimpleNamespace(get_logger=lambda: SimpleNamespace(warning=said.append))
    nothing: Any = None
    optional.offer_services(node, nothing, nothing, nothing, may_quit=True)
    (line,) = said
    assert line.startswith("no services of simulation_interfaces: ") and words in line
    assert "\n" not in line
