"""Which tests mirror modules whose tables and numbers can be written by hand: no run is needed.

A mutant costs them less than a second, in plain Python and compiled.
"""

from __future__ import annotations

OF_WATCHES = {
    "bounds": ("between_samples", "bounds", "finer"),
    "counts": ("chatter", "contact_events", "exchanged", "gaps", "pace"),
    "effort_watch": ("effort_watch",),
    "imbalance": ("imbalance", "impulses", "loads"),
    "little": ("little",),
    "little_between": ("little_between",),
    "period": ("period",),
    "quadrature": ("quadrature",),
    "resolution": ("resolution",),
    "step_trials": ("step_search",),
    "vanishing": ("vanishing",),
    "violated": ("violated",),
    "watched": ("watched",),
}
"""Test -> modules of rb_sim/checks."""
OF_EVENTS = {
    "decompositions": ("instant",),
    "left_open": ("left_open",),
    "redundant": ("redundant",),
    "routh": ("instant",),
}
"""Test -> modules of rb_sim/contact/events."""
BY_HAND: dict[str, tuple[str, ...]] = {
    f"rb_sim/{package}/{module}.py": (f"tests/{package}/test_{test}.py",)
    for package, tests in (("watches", OF_WATCHES), ("contact/events", OF_EVENTS))
    for test, modules in tests.items()
    for module in modules
}
BY_HAND |= {
    f"rb_sim/contact/solvers/{module}.py": (f"tests/contact/solvers/test_solvers.py::test_{law}",)
    for module, law in (
        ("newton", "newton_ends_where_gauss_seidel_does"),
        ("one_contact", "one_contact_is_exact"),
        ("proximal_newton", "newton_in_the_velocities_of_bodies"),
    )
}
BY_HAND |= {
    "rb_sim/contact/problem/impacts.py": ("tests/contact/events/test_impacts.py",),
    "rb_sim/contact/events/shares.py": (
        "tests/contact/events/test_shared_loads.py::test_the_bounds_of_contacts_by_hand",
    ),
    "rb_sim/contact/grid_motion.py": ("tests/contact/test_grid_motion.py",),
    "rb_sim/scene/compile_contacts.py": ("tests/contact/test_grid_motion.py",),
    **{
        f"rb_sim/contact/solvers/{module}.py": (
            "tests/contact/solvers/test_relaxing.py",
            "tests/contact/solvers/test_solvers.py::test_gauss_seidel_solves",
        )
        for module in ("gauss_seidel", "graph")
    },
    "rb_sim/contact/solvers/hybrid.py": (
        "tests/contact/solvers/test_together.py",
        "tests/contact/solvers/test_solvers.py::test_sweeps_tell_how_near_they_are",
    ),
    "rb_sim/contact/solvers/newton.py": ("tests/contact/solvers/test_problem.py",),
    "rb_sim/contact/solvers/graph.py": ("tests/contact/solvers/test_problem.py",),
    "rb_sim/contact/solvers/gauss_seidel.py": (
        "tests/contact/solvers/test_joint_block.py",
        "tests/contact/solvers/test_joints_that_follow.py",
    ),
    "rb_sim/contact/solvers/proximal_newton.py": ("tests/contact/solvers/test_body_blocks.py",),
    "rb_sim/contact/tunnelling.py": (
        "tests/contact/test_depths_of_sides.py",
        "tests/contact/test_sides.py",
    ),
    "rb_sim/contact/events/stepping.py": ("tests/mechanics/contact/test_jacobian.py",),
    "rb_sim/contact/events/steps.py": tuple(
        f"tests/mechanics/contact/test_choice.py::test_{law}"
        for law in (
            "the_lines_chosen_are_those_of_cholesky_with_pivots",
            "lines_that_leave_no_choice_stay_as_they_were",
        )
    ),
    "rb_sim/mechanics/initial_projection.py": ("tests/compiler/test_kept_laws.py",),
    "rb_sim/mechanics/laws.py": (
        "tests/mechanics/test_reduced_laws.py",
        "tests/mechanics/test_series_variables.py",
    ),
    "rb_sim/motion/traced.py": (
        "tests/mechanics/test_laws.py::test_a_run_in_parts_is_the_run_in_one_bit_for_bit",
        "tests/mechanics/test_laws.py::test_every_method_gives_the_same_numbers_interpreted",
        "tests/mechanics/test_small_swings.py",
        "tests/mechanics/test_traced.py",
        "tests/integrate/test_worst.py",
    ),
    "rb_sim/simulation/sensitivity.py": ("tests/mechanics/test_tangent_laws.py",),
    "rb_sim/mechanics/inputs.py": ("tests/mechanics/test_places.py",),
    "rb_sim/mechanics/samples.py": ("tests/mechanics/test_samples.py",),
    **{
        f"rb_sim/contact/{module}.py": (
            "tests/contact/test_scales.py",
            f"tests/contact/test_{test}.py",
        )
        for module, test in (("compile", "start"), ("start", "start"), ("looks", "looks"))
    },
    **{
        f"rb_sim/catalogue/contacts/{module}.py": (f"tests/catalogue/contacts/test_{module}.py",)
        for module in ("contact", "sides", "surfaces", "touching")
    },
    "rb_sim/contact/events/event_motion.py": (
        *(
            tuple(
                f"tests/contact/events/test_{test}.py"
                for test in (
                    "lifting",
                    "tasks",
                    "leap",
                    "painleve",
                    "motion",
                )
            )
        ),
        "tests/contact/events/test_over_edges.py",
    ),  # fmt: skip
    "rb_sim/contact/events/tasks.py": ("tests/contact/events/test_tasks.py",),
    "rb_sim/contact/choose_motion.py": ("tests/contact/test_motion.py",),
    "rb_sim/numerics/kernels.py": ("tests/numerics/test_own_time.py",),
    "rb_sim/mechanics/lane_motions.py": ("tests/sweeps/test_lanes.py",),
    "rb_sim/catalogue/spec.py": ("tests/catalogue/test_spec.py",),
    "rb_sim/scene/compiled.py": ("tests/mechanics/test_recent.py",),
    "rb_sim/checks/step_search.py": ("tests/accuracy/test_forecast.py",),
    "rb_sim/checks/balance.py": (
        "tests/checks/test_ledger.py",
        "tests/checks/test_watch_list.py",
    ),
    "rb_sim/checks/singular_configuration.py": ("tests/checks/test_dead_point.py",),
    "rb_sim/checks/check_list.py": (
        "tests/checks/test_watch_list.py",
        "tests/checks/test_corrupted.py",
    ),
}
