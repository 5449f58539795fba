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
