# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A script that workers would run again is refused before one starts; others are not."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType

import pytest

from rb_sim.base.errors import RbSimError
from rb_sim.sweeps.sweep import check_guarded

CALL = "from rb_sim.sweeps.sweep import check_guarded\n"


def run(script: Path, text: str) -> None:
    """As `python script` does, in this process."""
    script.write_text(text)
    runpy.run_path(str(script), run_name="__main__")


@pytest.mark.parametrize(
    "text",
    [
        "check_guarded()\n",
        "def main():\n    check_guarded()\n\nmain()\n",
        "if __name__ == '__main__':\n    pass\ncheck_guarded()\n",
        "if True:\n    check_guarded()\n",
    ],
)
def test_a_call_that_workers_would_come_to_is_refused(tmp_path: Path, text: str) -> None:
    line = 2 + text.rstrip().count("\n")
    with pytest.raises(RbSimError, match=rf"script.py:{line}: .*must be below `if __name__ =="):
        run(tmp_path / "script.py", CALL + text)


@pytest.mark.parametrize(
    "text",
    [
        "if __name__ == '__main__':\n    check_guarded()\n",
        "def main():\n    check_guarded()\n\nif '__main__' == __name__:\n    main()\n",
    ],
)
def test_a_guarded_call_goes_on(tmp_path: Path, text: str) -> None:
    run(tmp_path / "script.py", CALL + text)


def test_a_sweep_asks_before_it_makes_anything(tmp_path: Path) -> None:
    out = tmp_path / "out"
    text = f"import rb_sim\nrb_sim.sweep('rotor_imbalance', {str(out)!r}, workers=1)\n"
    with pytest.raises(RbSimError, match="starts workers, which import this file"):
        run(tmp_path / "script.py", text)
    assert not out.exists()


def test_what_is_typed_in_is_imported_by_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    typed = ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", typed)
    exec("check_guarded()", vars(typed) | {"check_guarded": check_guarded})
