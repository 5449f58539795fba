"""Which tests mirror a module: those that `python -m benchmarks.mutants` runs on its faults.

The fastest that say what the module does, in plain Python where no run is needed.
"""

from __future__ import annotations

from benchmarks.mirrors_by_hand import BY_HAND

SYSTEM = ("tests/contact/test_lines.py", "tests/contact/test_between_bodies.py")
STEPPING = (
    "tests/contact/stepping/test_laws_of_a_step.py",
    "tests/contact/test_time_stepping.py",
)
ONE_BODY = ("tests/engine/test_one_body_laws.py",)
BETWEEN = ("tests/properties/test_between_bodies.py",)
EFFECTS = ("tests/catalogue/test_effects.py", *ONE_BODY)
SERIES = ("tests/engine/test_series_variables.py",)
JOINTS = ("tests/catalogue/test_joints.py",)
ROWS = ("tests/properties/test_catalogue.py::test_rows_agree_with_differences", *ONE_BODY)
SPLINES = (
    "tests/engine/test_guide_laws.py",
    "tests/engine/test_guides.py::test_the_slope_of_the_nearest_parameter",
    "tests/catalogue/test_curves.py",
)
MANY_BODIES = ("tests/engine/test_many_body_laws.py", "tests/engine/test_manifold_laws.py")
CHOICE = tuple(
    f"tests/engine/test_choice.py::test_{law}"
    for law in (
        "the_choice_is_that_of_cholesky_with_pivots",
        "of_equal_lines_round_off_does_not_choose",
        "only_lines_in_loops_that_hold_too_much_are_chosen_anew",
    )
)
"""Tests that many modules of a package share: of its tables, of its steps, of its laws."""
TARGETS: dict[str, tuple[str, ...]] = {
    "rb_sim/maths/cubic.py": ("tests/maths/test_cubic.py",),
    "rb_sim/maths/vectors.py": ("tests/maths/test_vectors.py",),
    "rb_sim/catalogue/effects/spring.py": (
        "tests/catalogue/test_spring.py",
        "tests/catalogue/test_effects.py",
        "tests/properties/test_between_bodies.py",
    ),
    "rb_sim/catalogue/effects/torsion.py": (
        "tests/catalogue/test_torsion.py",
        "tests/catalogue/test_effects.py",
        "tests/properties/test_between_bodies.py",
    ),
    "rb_sim/contact/friction.py": (
        "tests/contact/test_friction.py",
        "tests/contact/test_lines.py",
    ),
    "rb_sim/contact/geometry/rims.py": ("tests/contact/geometry/test_rims.py",),
    "rb_sim/contact/system/swings.py": ("tests/contact/system/test_swings.py",),
    "rb_sim/contact/geometry/pairs.py": (
        "tests/contact/geometry/test_pairs.py",
        "tests/contact/geometry/test_solids.py",
    ),
    "rb_sim/contact/geometry/curved.py": (
        "tests/contact/geometry/test_curved.py",
        "tests/contact/test_every_pair.py",
    ),
    "rb_sim/contact/geometry/shapes.py": ("tests/contact/geometry/test_shapes.py",),
    "rb_sim/contact/geometry/solids.py": ("tests/contact/geometry/test_solids.py",),
    "rb_sim/contact/geometry/points_on_solids.py": (
        "tests/contact/geometry/test_points_on_solids.py",
    ),
    "rb_sim/contact/geometry/rims_on_cylinders.py": (
        "tests/contact/geometry/test_rims_on_cylinders.py",
        "tests/contact/test_every_pair.py",
    ),
    "rb_sim/contact/geometry/carriers.py": ("tests/contact/geometry/test_carriers.py",),
    "rb_sim/contact/geometry/hull.py": ("tests/contact/geometry/test_solids.py",),
    "rb_sim/contact/system/accelerations.py": (
        "tests/contact/system/test_accelerations.py",
        "tests/contact/test_between_bodies.py",
        "tests/contact/system/test_manifold.py",
        "tests/contact/test_every_pair.py",
    ),
    "rb_sim/contact/system/bodies.py": (*SYSTEM, "tests/contact/events/test_delassus.py"),
    "rb_sim/contact/system/layout.py": SYSTEM,
    "rb_sim/contact/system/levels.py": (
        "tests/contact/system/test_levels.py",
        "tests/contact/events/test_dips.py",
    ),
    "rb_sim/contact/system/lines.py": SYSTEM,
    "rb_sim/contact/system/manifold.py": ("tests/contact/system/test_manifold.py",),
    "rb_sim/contact/system/rates.py": ("tests/contact/system/test_rates.py", *SYSTEM),
    "rb_sim/contact/system/terms.py": (*SYSTEM, "tests/contact/events/test_delassus.py"),
    "rb_sim/contact/system/touch.py": ("tests/contact/system/test_touch.py", *SYSTEM),
    "rb_sim/contact/stepping/after.py": ("tests/contact/stepping/test_after.py", *STEPPING),
    "rb_sim/contact/stepping/apart.py": ("tests/contact/stepping/test_apart.py", *STEPPING),
    "rb_sim/contact/stepping/bends.py": (
        "tests/contact/stepping/test_bends.py",
        "tests/contact/stepping/test_after.py",
    ),
    "rb_sim/contact/geometry/boxes.py": ("tests/contact/stepping/test_boxes.py",),
    "rb_sim/contact/stepping/geometry.py": (
        "tests/contact/stepping/test_geometry.py",
        "tests/contact/stepping/test_slots.py",
        "tests/contact/stepping/test_joints.py",
        *STEPPING,
    ),
    "rb_sim/contact/stepping/joints.py": (
        "tests/contact/stepping/test_motion.py",
        "tests/contact/stepping/test_joints.py::test_laws_of_the_joints_are_the_kernels",
    ),
    "rb_sim/contact/stepping/lines.py": ("tests/contact/stepping/test_lines.py", *STEPPING),
    "rb_sim/contact/stepping/loop.py": (
        "tests/contact/stepping/test_loop.py",
        "tests/contact/stepping/test_motion.py",
        *STEPPING,
    ),
    "rb_sim/contact/stepping/motion.py": ("tests/contact/stepping/test_motion.py",),
    "rb_sim/contact/stepping/rebounds.py": ("tests/contact/stepping/test_rebounds_by_hand.py",),
    "rb_sim/contact/stepping/room.py": ("tests/contact/stepping/test_room.py",),
    "rb_sim/contact/stepping/parts.py": (
        "tests/contact/stepping/test_aims.py",
        "tests/contact/stepping/test_thrown.py",
    ),
    "rb_sim/contact/stepping/step.py": ("tests/contact/stepping/test_step.py", *STEPPING),
    "rb_sim/contact/stepping/tables.py": ("tests/contact/stepping/test_geometry.py", *STEPPING),
    "rb_sim/sinks/contact_power.py": ("tests/sinks/test_contact_power.py",),
    "rb_sim/contact/events/search.py": (
        "tests/contact/events/test_dips.py",
        "tests/contact/events/test_grazes.py",
        "tests/contact/events/test_motion.py",
    ),
    "rb_sim/contact/events/grazes.py": ("tests/contact/events/test_grazes.py",),
    "rb_sim/contact/events/order.py": (
        "tests/contact/events/test_order.py",
        "tests/contact/events/test_grazes.py",
    ),
    "rb_sim/maths/complementarity.py": ("tests/maths/test_complementarity.py",),
    "rb_sim/catalogue/effects/gravity.py": (
        "tests/scene/test_load.py",
        "tests/properties/test_catalogue.py",
        *EFFECTS,
    ),
    "rb_sim/catalogue/effects/drag.py": (*EFFECTS, *BETWEEN),
    "rb_sim/catalogue/effects/wrench.py": ("tests/catalogue/test_wrench.py", *EFFECTS),
    "rb_sim/catalogue/inertia.py": ("tests/catalogue/test_spec.py",),
    "rb_sim/catalogue/curves.py": (*SPLINES, *ONE_BODY),
    "rb_sim/catalogue/splines.py": SPLINES,
    "rb_sim/catalogue/spline_tables.py": SPLINES,
    "rb_sim/catalogue/constraints/curve_row.py": ROWS,
    "rb_sim/catalogue/constraints/fixed_axis.py": JOINTS,
    "rb_sim/catalogue/constraints/joints.py": JOINTS,
    "rb_sim/catalogue/constraints/rolling.py": ("tests/catalogue/test_rolling.py", *JOINTS, *ROWS),
    "rb_sim/catalogue/constraints/rows.py": (*JOINTS, *ROWS),
    "rb_sim/catalogue/constraints/simple.py": JOINTS,
    "rb_sim/catalogue/constraints/translation.py": ONE_BODY,
    "rb_sim/engine/one_body.py": ONE_BODY,
    "rb_sim/engine/systems/free.py": ONE_BODY,
    "rb_sim/engine/systems/fixed_point.py": ONE_BODY,
    "rb_sim/engine/systems/fixed_axis.py": ONE_BODY,
    "rb_sim/engine/systems/free_rotor.py": ("tests/engine/test_polhode.py", *ONE_BODY),
    "rb_sim/engine/systems/translation.py": ONE_BODY,
    "rb_sim/engine/systems/rolling.py": ONE_BODY,
    "rb_sim/maths/rank.py": ("tests/maths/test_rank.py",),
    "rb_sim/maths/least_squares.py": ("tests/maths/test_least_squares.py",),
    "rb_sim/maths/semidefinite.py": ("tests/maths/test_semidefinite.py",),
    "rb_sim/maths/unsymmetric.py": ("tests/maths/test_unsymmetric.py",),
    "rb_sim/maths/cones.py": ("tests/maths/test_cone_program.py",),
    "rb_sim/maths/cone_polish.py": ("tests/maths/test_cone_program.py",),
    "rb_sim/maths/cone_program.py": ("tests/maths/test_cone_program.py",),
    "rb_sim/maths/complementarity_search.py": (
        "tests/maths/test_numbering.py",
        "tests/maths/test_complementarity.py",
    ),
    "rb_sim/engine/systems/multibody.py": MANY_BODIES,
    "rb_sim/engine/systems/many_bodies.py": MANY_BODIES,
    "rb_sim/engine/systems/multipliers.py": MANY_BODIES,
    "rb_sim/engine/systems/elimination.py": ("tests/engine/test_elimination.py", *MANY_BODIES),
    "rb_sim/engine/systems/free_spin.py": ("tests/engine/test_polhode.py",),
    "rb_sim/engine/systems/least_norm.py": ("tests/engine/test_least_norm.py",),
    "rb_sim/engine/systems/choice.py": (*CHOICE, *MANY_BODIES),
    "rb_sim/engine/multibody_laws.py": MANY_BODIES,
    "rb_sim/engine/solved_lines.py": MANY_BODIES,
    "rb_sim/engine/object_tables.py": MANY_BODIES,
    "rb_sim/engine/hubs.py": MANY_BODIES,
    "rb_sim/engine/independent.py": (
        *CHOICE,
        "tests/engine/test_independent.py::"
        "test_the_lines_left_are_as_many_as_the_rank_and_well_conditioned",
        *MANY_BODIES,
    ),
    "rb_sim/engine/methods/registry.py": ("tests/engine/test_registry.py",),
    "rb_sim/engine/velocities.py": ("tests/engine/test_velocities.py",),
    "rb_sim/engine/manifold.py": MANY_BODIES,
    "rb_sim/engine/turning.py": (
        "tests/engine/test_turning.py",
        "tests/engine/test_small_motions.py",
    ),
    "rb_sim/engine/small_motions.py": (
        "tests/engine/test_turning.py",
        "tests/engine/test_pairs.py",
        "tests/engine/test_small_motions.py",
    ),
    "rb_sim/engine/relative_motions.py": (
        "tests/engine/test_pairs.py",
        "tests/engine/test_relative_motions.py",
    ),
    "rb_sim/engine/guides.py": ("tests/engine/test_guide_laws.py",),
    "rb_sim/engine/series/__init__.py": SERIES,
    "rb_sim/engine/series/fixed_axis.py": SERIES,
    "rb_sim/engine/series/rolling_disk.py": SERIES,
    "rb_sim/engine/series/rolling_sphere.py": SERIES,
    "rb_sim/engine/tables/laws.py": MANY_BODIES,
    "rb_sim/engine/tables/blocks.py": MANY_BODIES,
    "rb_sim/engine/tables/block_kernels.py": MANY_BODIES,
    "rb_sim/engine/tables/block_products.py": MANY_BODIES,
    "rb_sim/engine/tables/graph_of_lines.py": (
        *(
            f"tests/engine/test_tables.py::test_{law}"
            for law in (
                "hubs_are_bodies_whose_arms_hold_nothing_else",
                "the_elimination_of_a_chain_meets_one_neighbour_a_link",
                "the_hub_of_a_star_goes_after_its_arms_which_are_no_neighbours",
            )
        ),
        *MANY_BODIES,
    ),
    "rb_sim/engine/tables/kinds.py": MANY_BODIES,
    "rb_sim/engine/tables/lines.py": MANY_BODIES,
    "rb_sim/engine/tables/local.py": ("tests/engine/test_local_tables.py", *MANY_BODIES),
    "rb_sim/engine/tables/local_lines.py": MANY_BODIES,
} | BY_HAND
"""Modules, and the tests that mirror them: files, or a test as FILE::NAME."""
