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
ONE_BODY = ("tests/mechanics/test_one_body_laws.py",)
BETWEEN = ("tests/properties/test_between_bodies.py",)
EFFECTS = ("tests/catalogue/test_effects.py", *ONE_BODY)
SERIES = ("tests/mechanics/test_series_variables.py",)
JOINTS = ("tests/catalogue/test_joints.py",)
ROWS = ("tests/properties/test_catalogue.py::test_rows_agree_with_differences", *ONE_BODY)
SPLINES = (
    "tests/mechanics/test_guide_laws.py",
    "tests/mechanics/test_guides.py::test_the_slope_of_the_nearest_parameter",
    "tests/catalogue/test_curves.py",
)
MANY_BODIES = ("tests/mechanics/test_many_body_laws.py", "tests/mechanics/test_manifold_laws.py")
CHOICE = tuple(
    f"tests/mechanics/test_choice.py::test_{law}"
    for law in (
        "the_choice_is_that_of_cholesky_with_pivots",
        "of_equal_lines_round_off_does_not_choose",
        "only_lines_in_loops_that_hold_too_much_are_chosen_anew",
    )
)
"""Tests that many modules of a package share: of its tables, of its steps, of its laws."""
TARGETS: dict[str, tuple[str, ...]] = {
    "rb_sim/integrate/quadrature.py": ("tests/numerics/test_cubic.py",),
    "rb_sim/numerics/vectors.py": ("tests/numerics/test_vectors.py",),
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
    "rb_sim/catalogue/contacts/friction.py": (
        "tests/contact/test_friction.py",
        "tests/contact/test_lines.py",
    ),
    "rb_sim/catalogue/geometry/corners_and_rims.py": (
        "tests/catalogue/geometry/test_rims.py",
        "tests/catalogue/geometry/test_points_on_solids.py",
        "tests/catalogue/geometry/test_rims_on_cylinders.py",
        "tests/contact/test_every_pair.py",
    ),
    "rb_sim/mechanics/contact/near_flat_rims.py": ("tests/mechanics/contact/test_swings.py",),
    "rb_sim/catalogue/geometry/pairs.py": (
        "tests/catalogue/geometry/test_pairs.py",
        "tests/catalogue/geometry/test_solids.py",
    ),
    "rb_sim/catalogue/geometry/curved.py": (
        "tests/catalogue/geometry/test_curved.py",
        "tests/contact/test_every_pair.py",
    ),
    "rb_sim/catalogue/geometry/smooth_surfaces.py": ("tests/catalogue/geometry/test_shapes.py",),
    "rb_sim/catalogue/geometry/solids.py": ("tests/catalogue/geometry/test_solids.py",),
    "rb_sim/catalogue/geometry/carriers.py": ("tests/catalogue/geometry/test_carriers.py",),
    "rb_sim/catalogue/geometry/hull.py": ("tests/catalogue/geometry/test_solids.py",),
    "rb_sim/mechanics/contact/accelerations.py": (
        "tests/mechanics/contact/test_accelerations.py",
        "tests/contact/test_between_bodies.py",
        "tests/mechanics/contact/test_manifold.py",
        "tests/contact/test_every_pair.py",
    ),
    "rb_sim/mechanics/contact/contact_bodies.py": (
        *SYSTEM,
        "tests/contact/events/test_delassus.py",
    ),
    "rb_sim/mechanics/contact/constraint_tables.py": (*SYSTEM,),
    "rb_sim/mechanics/contact/event_functions.py": (
        "tests/mechanics/contact/test_levels.py",
        "tests/contact/events/test_dips.py",
    ),
    "rb_sim/mechanics/contact/contact_projection.py": ("tests/mechanics/contact/test_manifold.py",),
    "rb_sim/mechanics/contact/motion_kernels.py": (
        "tests/mechanics/contact/test_rates.py",
        *SYSTEM,
    ),
    "rb_sim/mechanics/contact/contact_kinematics.py": (
        *SYSTEM,
        "tests/contact/events/test_delassus.py",
    ),
    "rb_sim/mechanics/contact/contact_table.py": ("tests/mechanics/contact/test_touch.py", *SYSTEM),
    "rb_sim/contact/stepping/after.py": ("tests/contact/stepping/test_convergence.py", *STEPPING),
    "rb_sim/contact/stepping/step_kernels.py": (
        "tests/contact/stepping/test_ends_of_steps.py",
        "tests/contact/stepping/test_momentum_of_samples.py",
        *STEPPING,
        "tests/contact/stepping/test_motion.py",
        "tests/contact/stepping/test_aims.py",
        "tests/contact/stepping/test_thrown.py",
    ),
    "rb_sim/contact/stepping/normal_change.py": ("tests/contact/stepping/test_bends.py",),
    "rb_sim/catalogue/geometry/boxes.py": ("tests/contact/stepping/test_boxes.py",),
    "rb_sim/contact/stepping/geometry.py": (
        "tests/contact/stepping/test_heaps.py",
        "tests/contact/stepping/test_joints.py",
        *STEPPING,
    ),
    "rb_sim/contact/stepping/stepping_motion.py": ("tests/contact/stepping/test_motion.py",),
    "rb_sim/contact/stepping/constraint_rows.py": (
        "tests/contact/stepping/test_lines.py",
        *STEPPING,
    ),
    "rb_sim/contact/stepping/step.py": (
        "tests/contact/stepping/test_rebounds.py",
        "tests/contact/stepping/test_ends_of_steps.py",
        *STEPPING,
    ),
    "rb_sim/contact/stepping/scene_tables.py": STEPPING,
    "rb_sim/io/contact_power.py": ("tests/io/test_contact_power.py",),
    "rb_sim/contact/events/search.py": (
        "tests/contact/events/test_dips.py",
        "tests/contact/events/test_motion.py",
    ),
    "rb_sim/numerics/complementarity.py": (
        "tests/numerics/test_complementarity.py",
        "tests/numerics/test_numbering.py",
    ),
    "rb_sim/catalogue/effects/gravity.py": (
        "tests/scene/test_load.py",
        "tests/properties/test_catalogue.py",
        *EFFECTS,
    ),
    "rb_sim/catalogue/effects/drag.py": (*EFFECTS, *BETWEEN),
    "rb_sim/catalogue/effects/wrench.py": ("tests/catalogue/test_wrench.py", *EFFECTS),
    "rb_sim/scene/shapes.py": ("tests/catalogue/test_spec.py",),
    "rb_sim/catalogue/curves.py": (*SPLINES, *ONE_BODY),
    "rb_sim/catalogue/splines.py": (*SPLINES,),
    "rb_sim/catalogue/constraints/rows.py": (
        *ROWS,
        *JOINTS,
    ),
    "rb_sim/catalogue/constraints/fixed_axis.py": JOINTS,
    "rb_sim/catalogue/constraints/joints.py": JOINTS,
    "rb_sim/catalogue/constraints/rolling.py": ("tests/catalogue/test_rolling.py", *JOINTS, *ROWS),
    "rb_sim/catalogue/constraints/simple.py": JOINTS,
    "rb_sim/catalogue/constraints/translation.py": ONE_BODY,
    "rb_sim/mechanics/systems/one_body.py": ONE_BODY,
    "rb_sim/mechanics/systems/free.py": (
        *ONE_BODY,
        "tests/mechanics/test_polhode.py",
    ),
    "rb_sim/mechanics/systems/fixed_point.py": ONE_BODY,
    "rb_sim/mechanics/systems/fixed_axis.py": ONE_BODY,
    "rb_sim/mechanics/systems/translation.py": ONE_BODY,
    "rb_sim/mechanics/systems/rolling.py": ONE_BODY,
    "rb_sim/numerics/rank.py": ("tests/numerics/test_rank.py",),
    "rb_sim/numerics/linear_solves.py": (
        "tests/numerics/test_least_squares.py",
        "tests/numerics/test_semidefinite.py",
        "tests/numerics/test_unsymmetric.py",
    ),
    "rb_sim/numerics/cone_program.py": ("tests/numerics/test_cone_program.py",),
    "rb_sim/mechanics/systems/multibody.py": MANY_BODIES,
    "rb_sim/mechanics/systems/many_bodies.py": MANY_BODIES,
    "rb_sim/mechanics/systems/multipliers.py": MANY_BODIES,
    "rb_sim/mechanics/systems/elimination.py": (
        "tests/mechanics/test_elimination.py",
        *MANY_BODIES,
        "tests/mechanics/test_least_norm.py",
        *CHOICE,
    ),
    "rb_sim/mechanics/multibody_laws.py": (*MANY_BODIES,),
    "rb_sim/mechanics/independent.py": (
        *CHOICE,
        "tests/mechanics/test_independent.py::"
        "test_the_lines_left_are_as_many_as_the_rank_and_well_conditioned",
        *MANY_BODIES,
    ),
    "rb_sim/mechanics/methods.py": ("tests/mechanics/test_registry.py",),
    "rb_sim/mechanics/error_scales.py": (
        "tests/mechanics/test_velocities.py",
        "tests/mechanics/test_turning.py",
        "tests/mechanics/test_small_motions.py",
        "tests/mechanics/test_pairs.py",
        "tests/mechanics/test_relative_motions.py",
    ),
    "rb_sim/mechanics/initial_projection.py": MANY_BODIES,
    "rb_sim/mechanics/systems/guides.py": ("tests/mechanics/test_guide_laws.py",),
    "rb_sim/engine/series/__init__.py": SERIES,
    "rb_sim/mechanics/taylor_variables.py": (*SERIES,),
    "rb_sim/mechanics/tables/table_laws.py": MANY_BODIES,
    "rb_sim/mechanics/tables/blocks.py": (
        *MANY_BODIES,
        *(
            f"tests/mechanics/test_tables.py::test_{law}"
            for law in (
                "hubs_are_bodies_whose_arms_hold_nothing_else",
                "the_elimination_of_a_chain_meets_one_neighbour_a_link",
                "the_hub_of_a_star_goes_after_its_arms_which_are_no_neighbours",
            )
        ),
    ),
    "rb_sim/mechanics/tables/program_rows.py": (*MANY_BODIES,),
    "rb_sim/mechanics/tables/local.py": (
        "tests/mechanics/test_local_tables.py",
        *MANY_BODIES,
    ),
} | BY_HAND
"""Modules, and the tests that mirror them: files, or a test as FILE::NAME."""
