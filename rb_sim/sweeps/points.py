"""The values of the varied numbers: every run of a plan is one row."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from scipy import stats
from scipy.stats import qmc

from rb_sim.errors import MissingExtraError, RbSimError
from rb_sim.sweeps.plan import Plan, Vary


def points(plan: Plan) -> dict[str, np.ndarray]:
    """The value of each varied name in every run, shape (runs,) each.

    Runs are ordered with the draws innermost: every point of the grid sees the same draws (common
    random numbers).  The same plan gives the same values on every machine.
    """
    draws = _drawn(plan)
    count = len(next(iter(draws.values()))) if draws else 1
    shape = plan.grid_shape
    grid_index = np.arange(int(np.prod(shape, dtype=int)))
    unravelled = iter(np.unravel_index(grid_index, shape) if shape else ())
    table = {}
    for name, vary in plan.vary.items():
        if vary.random:
            table[name] = np.tile(draws[name], len(grid_index))
        else:
            table[name] = np.repeat(listed(vary)[next(unravelled)], count)
    return table


def listed(vary: Vary) -> np.ndarray:
    """The values of a number that is not drawn."""
    if vary.grid is None:
        return np.array(vary.values, dtype=float)
    grid = vary.grid
    space = np.geomspace if grid.spacing == "log" else np.linspace
    return space(grid.start, grid.stop, grid.count)


def _drawn(plan: Plan) -> dict[str, np.ndarray]:
    """The draws of each drawn name."""
    names = plan.drawn
    if not names:
        return {}
    u = _unit_cube(plan, len(names))
    if plan.correlations:
        u = stats.norm.cdf(stats.norm.ppf(u) @ _factor(plan, names).T)
    return {name: _quantile(plan.vary[name], u[:, i]) for i, name in enumerate(names)}


def _unit_cube(plan: Plan, dimensions: int) -> np.ndarray:
    """Points in the open unit cube, shape (draws, dimensions)."""
    assert plan.draws is not None
    if plan.sampling == "saltelli":
        return _saltelli(plan, dimensions)
    engines: dict[str, Any] = {"sobol": qmc.Sobol, "latin_hypercube": qmc.LatinHypercube}
    if plan.sampling == "random":
        u = np.random.default_rng(plan.seed).random((plan.draws, dimensions))
    else:
        with warnings.catch_warnings():  # a number of draws that is no power of 2 is allowed
            warnings.simplefilter("ignore", UserWarning)
            u = engines[plan.sampling](dimensions, seed=plan.seed).random(plan.draws)
    tiny = np.finfo(float).tiny
    return np.clip(u, tiny, 1.0 - np.finfo(float).epsneg)


def _saltelli(plan: Plan, dimensions: int) -> np.ndarray:
    """Saltelli's design for Sobol indices of first and total order (SALib)."""
    try:
        from SALib.sample import sobol
    except ImportError as error:
        raise MissingExtraError("SALib", "sweep", "sampling saltelli") from error
    assert plan.draws is not None
    problem = saltelli_problem([str(i) for i in range(dimensions)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        u = sobol.sample(problem, plan.draws, calc_second_order=False, seed=plan.seed)
    return np.clip(u, np.finfo(float).tiny, 1.0 - np.finfo(float).epsneg)


def saltelli_problem(names: list[str]) -> dict[str, Any]:
    """SALib's description of numbers that are uniform on [0, 1]."""
    return {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}


def _factor(plan: Plan, names: tuple[str, ...]) -> np.ndarray:
    """Cholesky factor of the correlations; raises RbSimError where they contradict each other."""
    matrix = np.eye(len(names))
    for pair in plan.correlations:
        i, j = (names.index(name) for name in pair.between)
        matrix[i, j] = matrix[j, i] = pair.coefficient
    try:
        return np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        raise RbSimError(
            "correlations: no numbers can have all of them at once (the matrix is not positive "
            "definite); make them smaller"
        ) from None


def _quantile(vary: Vary, u: np.ndarray) -> np.ndarray:
    """The values of a drawn number at the probabilities u."""
    if vary.normal is not None:
        return vary.normal.mean + vary.normal.std * stats.norm.ppf(u)
    if vary.uniform is not None:
        low, high = vary.uniform
        return low + (high - low) * u
    assert vary.log_uniform is not None
    low, high = np.log(vary.log_uniform)
    return np.exp(low + (high - low) * u)
