"""How a motion has been integrated so far: what its steps cost and what they had to leave."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rb_sim.motion import Motion

if TYPE_CHECKING:
    from rb_sim.contact.events.left_open import LeftOpen


class InSteps:
    """Counts of the steps of a motion since its start."""

    _motion: Motion

    @property
    def steps(self) -> int:
        """Steps taken since the start, those not needed for a sample included."""
        return self._motion.steps

    @property
    def rejected_steps(self) -> int:
        """Attempts that an adaptive method gave up since the start."""
        return self._motion.rejected_steps

    @property
    def cut_steps(self) -> int:
        """Of these the ones within the tolerance, which only went beyond the end of a piece of a
        spline."""
        return self._motion.cut_steps

    @property
    def unsolved_steps(self) -> tuple[int, float]:
        """Steps of time stepping whose friction problem was not solved within their bound of work,
        and the worst of their residuals, relative to the largest impulse; (0, 0.0) of others."""
        return self._motion.unsolved_steps, self._motion.solver_residual

    @property
    def solver_give(self) -> float:
        """How far time stepping let the law of a contact of a moving heap give way at most, as
        natural map relative to the largest impulse of its step: a heap that wedges itself has no
        solution nearer by.  Above 1e-2 the step counts as unsolved; 0.0 of other methods."""
        return self._motion.solver_give

    @property
    def circling_steps(self) -> int:
        """Steps of time stepping that were too long for a contact whose only point ran around its
        body while it bore, as that of a disk that comes to lie: energy is lost there that a shorter
        step keeps; 0 of others."""
        return self._motion.circling_steps

    @property
    def restruck_energy(self) -> float:
        """Energy that time stepping took where a contact bore already and was struck anew, since
        its point had moved on [J]: none is lost there in a motion, so that it is an error, which a
        shorter step makes smaller; 0.0 of other methods."""
        return self._motion.restruck_energy

    @property
    def made_energy(self) -> float:
        """Energy that rigid contacts have made under time stepping, where rubbing bodies come to
        stick or turn round within a step [J]: by their laws contacts take some or none, so that it
        is an error, which a shorter step makes smaller; 0.0 of other methods."""
        return self._motion.made_energy

    @property
    def astray(self) -> tuple[float, float, str]:
        """The largest velocity that an impulse of time stepping gave in a direction which the
        normal had left by the end of its step, over the scene's speed; when [s], and which contact:
        what passes a round surface in few steps is sent off where a shorter step would not; 0.0 of
        other methods."""
        figure, t, c = self._motion.astray
        return figure, t, self._motion.layout.contacts[c] if figure > 0.0 else ""

    @property
    def paradox_steps(self) -> int:
        """Steps of time stepping in which a contact that slips has Painleve's paradox, so that
        several impulses fit its laws, or none; 0 of others."""
        return self._motion.paradox_steps

    @property
    def slipping_steps(self) -> int:
        """Steps of time stepping in which a perfectly rough contact slipped, since friction would
        have lifted it; 0 of others."""
        return self._motion.slipping_steps

    @property
    def left_open(self) -> LeftOpen | None:
        """The widest choice that the laws of contact left: how far two motions that both obey them
        are apart, when, and where; None of what has no events."""
        return self._motion.left_open

    @property
    def held_bodies(self) -> frozenset[str]:
        """Bodies whose errors are held to their own small motion, not to max(1, |y|)."""
        return self._motion.held
