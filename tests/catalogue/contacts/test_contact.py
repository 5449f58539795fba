# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the mapping of a contact is refused for; what it does is in tests/contact."""

from __future__ import annotations

import pytest

from rb_sim.base.errors import SceneError
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import ball, scene, touch


def test_friction_that_grows_when_it_slips_is_refused() -> None:
    with pytest.raises(SceneError, match="at most static"):
        law = {"type": "coulomb", "static": 0.4, "kinetic": 0.5}
        scene_from_mapping(scene(ball([0.0, 0.0, 0.1]), touch(friction=law)))
