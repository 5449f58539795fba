"""A script that workers would run again is refused before one starts; others are not."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

CALL = "from rb_sim.sweeps.schedule import check_guarded\n"


def run(script: Path, text: str) -> subprocess.CompletedProcess[str]:
    script.write_text(text)
    return subprocess.run([sys.executable, str(script)], capture_output=True, text=True)


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
    done = run(tmp_path / "script.py", CALL + text)
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and "must be below `if __name__ ==" in last
    assert f"script.py:{2 + text.rstrip().count(chr(10))}:" in last


@pytest.mark.parametrize(
    "text",
    [
        "if __name__ == '__main__':\n    check_guarded()\n",
        "def main():\n    check_guarded()\n\nif '__main__' == __name__:\n    main()\n",
    ],
)
def test_a_guarded_call_goes_on(tmp_path: Path, text: str) -> None:
    assert run(tmp_path / "script.py", CALL + text).stderr == ""


def test_a_sweep_asks_before_it_makes_anything(tmp_path: Path) -> None:
    out = tmp_path / "out"
    text = f"import rb_sim\nrb_sim.sweep('rotor_imbalance', {str(out)!r}, workers=1)\n"
    done = run(tmp_path / "script.py", text)
    assert "starts workers, which import this file" in done.stderr and not out.exists()


def test_what_is_typed_in_is_imported_by_nobody() -> None:
    done = subprocess.run([sys.executable, "-c", CALL + "check_guarded()"], capture_output=True)
    assert done.stderr == b""
