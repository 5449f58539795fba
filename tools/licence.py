# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Puts the notice of the licence before each source file that lacks it: python -m tools.licence

The text is the one that ament_copyright recognises as Apache 2.0: it compares words, not lines, and
knows no SPDX line. Files without content need none, nor does setup.py beside package.xml.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NOTICE = """\
Copyright 2026 rb_sim contributors
Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
in compliance with the License. You may obtain a copy of the License at
http://www.apache.org/licenses/LICENSE-2.0
Unless required by applicable law or agreed to in writing, software distributed under the License
is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
or implied. See the License for the specific language governing permissions and limitations under
the License.
"""
COMMENTS = {".py": "# ", ".c": "// "}
FOLDERS = ("rb_sim", "tests", "tools", "benchmarks", "launch", "interfaces", "examples")


def lacking() -> list[Path]:
    """Source files that do not begin with the notice."""
    return [
        path
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*"))
        if path.suffix in COMMENTS
        and (text := path.read_text(encoding="utf-8"))
        and not text.startswith(notice(path))
    ]


def notice(path: Path) -> str:
    """The notice as a comment of the language of the file."""
    return "".join(f"{COMMENTS[path.suffix]}{line}\n" for line in NOTICE.splitlines())


def main() -> int:
    """Add what lacks; returns 0."""
    for path in lacking():
        text = path.read_text(encoding="utf-8")
        path.write_text(f"{notice(path)}\n{text}", encoding="utf-8")
        print(path.relative_to(ROOT))
    return 0


if __name__ == "__main__":
    sys.exit(main())
