# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A page that shows what its blocks do not give fails."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.docs.page_run import pictures, run_page, same_curves

PAGE = """# A page

```yaml
# held.yaml
bodies: {b: {mass: 1.0, inertia: [1, 1, 1]}}
```

```python
import rb_sim

print(rb_sim.load_scene("held.yaml").bodies["b"].mass, "kg")
```

```output
1.0 kg
```

```sh
rb_sim run held.yaml --duration 0.1 \\
    --no-rerun --quiet
```

![A picture](pictures/page/a.png)
"""


NEEDS_ROS = pytest.mark.skipif(find_spec("rclpy") is None, reason="no rclpy")


@pytest.fixture
def page(tmp_path, monkeypatch):
    """Gives what writes a page of this text, with an empty folder as the present one."""
    monkeypatch.chdir(tmp_path)

    def write(text: str) -> Path:
        (tmp_path / "page.md").write_text(text, encoding="utf-8")
        return tmp_path / "page.md"

    return write


@pytest.mark.filterwarnings("ignore::rb_sim.SceneWarning")
def test_a_page_runs_and_names_its_pictures(page):
    assert pictures(page(PAGE)) == ["a.png"]
    run_page(page(PAGE))


@pytest.mark.filterwarnings("ignore::rb_sim.SceneWarning")
@pytest.mark.parametrize(
    "right, wrong, message",
    [
        ("```output\n1.0 kg", "```output\n2.0 kg", "'2.0 kg' is not in"),
        ("--duration 0.1", "--duration -1", "line"),
        pytest.param(
            "run held.yaml", "node nowhere.yaml", "nowhere.yaml: does not exist", marks=NEEDS_ROS
        ),
        ("rb_sim run", "ls", "only rb_sim is run here"),
    ],
)
def test_a_page_that_is_wrong_fails(page, right, wrong, message):
    with pytest.raises(AssertionError, match=message):
        run_page(page(PAGE.replace(right, wrong)))


def test_pictures_of_other_curves_are_told_apart(page):
    """To a hundredth of a curve's height: another machine draws the same ones."""
    text = """```python
import matplotlib.pyplot as plt
import numpy as np

x = np.linspace(0, 1, 50)
figure, axes = plt.subplots()
axes.plot(x, FACTOR * np.sin(6 * x))
figure.savefig("a.png")
plt.close(figure)
```
"""
    one, near, other = (
        run_page(page(text.replace("FACTOR", factor)))["a.png"]
        for factor in ("1.0", "1.001", "1.1")
        if not Path("config").unlink(missing_ok=True)
    )
    assert same_curves(one, near) and not same_curves(one, other)
    assert not same_curves(one, [])
