"""Simulations that are stepped, and loads that Python adds."""

from __future__ import annotations

import signal

import numpy as np
import pytest

import rebond

#: Force at the corner (N) as a load of the scene; it is constant in the first step.
FORCE = "200 + 3e3*sin(300*max(t - 1e-4, 0))"


def push(time: float) -> float:
    """Return the same force (N) at a time (s)."""
    return 200 + 3e3 * np.sin(300 * max(time - 1e-4, 0))


@pytest.fixture
def still(fall: rebond.Scene) -> rebond.Scene:
    """Return the plate at rest, with nothing to hit."""
    return fall.set({"obstacle": []}, "initial.static_pressure=0", "time.end=0.02", "output.every=1")


def test_steps_are_those_of_a_run(fall: rebond.Scene) -> None:
    run = rebond.run(fall.set("output.every=1"))
    simulation = rebond.Simulation(fall)
    assert simulation.time == 0 and simulation.last.probes["corner"] == run.history["corner"][0]
    steps = [simulation.last, *simulation]
    assert [step.step for step in steps] == run.history["step"].tolist()
    assert [step.time for step in steps] == run.history["time"].tolist()
    for name in ("corner", "middle"):
        assert [step.probes[name] for step in steps] == run.history[name].tolist()
    for name in ("contact_nodes", "contact_force", "kkt"):
        assert [getattr(step, name) for step in steps] == run.history[name].tolist(), name
    energies = simulation.energies
    assert energies.total == pytest.approx(run.history["energy"][-1], rel=1e-14)
    assert energies.kinetic == run.history["kinetic"][-1]
    assert list(simulation) == []
    # The scheme goes on beyond the end of the scene.
    assert simulation.step(5).step == 805
    assert "step 805" in repr(simulation)


@pytest.mark.parametrize("scheme", ["newmark", "midpoint", "conserving"])
@pytest.mark.parametrize("mass", ["singular", "modal"])
def test_a_function_of_time_acts_as_a_load_of_the_scene(
    still: rebond.Scene, scheme: str, mass: str
) -> None:
    still = still.set(time={"scheme": scheme, "mass": mass})
    own = rebond.run(still.set({"load.force": [{"at": [1.2, 0.0], "value": FORCE}]}))
    corner = rebond.Model(still).at_point(1.2, 0.0)
    simulation = rebond.Simulation(still, force=lambda time: push(time) * corner)
    found = [simulation.last.probes["corner"], *(step.probes["corner"] for step in simulation)]
    expected = own.history["corner"]
    assert np.abs(expected).max() > 1e-3
    assert found == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())
    assert simulation.energies.total == pytest.approx(own.history["energy"][-1], rel=1e-8)


@pytest.mark.parametrize(("scheme", "ahead"), [("midpoint", 1), ("newmark", 2)])
def test_a_load_that_is_set_acts_as_a_load_of_the_scene(
    still: rebond.Scene, scheme: str, ahead: int
) -> None:
    still = still.set({"time.scheme": scheme})
    own = rebond.run(still.set({"load.force": [{"at": [1.2, 0.0], "value": FORCE}]}))
    corner = rebond.Model(still).at_point(1.2, 0.0)
    simulation = rebond.Simulation(still, force=push(0) * corner)
    found = [simulation.last.probes["corner"]]
    for step in range(still.steps):
        asked = max(step + ahead, 2) * still.time_step
        assert simulation.force_time == pytest.approx(asked)
        simulation.force[:] = push(simulation.force_time) * corner
        found.append(simulation.step().probes["corner"])
    expected = own.history["corner"]
    assert found == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())


def test_an_impulse_is_the_change_of_momentum(still: rebond.Scene) -> None:
    free = still.set({"support": []}, "time.scheme=midpoint")
    model = rebond.Model(free)
    matrices = model.matrices()
    rise = np.zeros(model.dofs)
    rise[model.node_dofs[:, 0]] = 1
    weights = model.at_point(0.7, 0.1) + 2 * model.at_point(0.2, 0.35)
    simulation = rebond.Simulation(free, force=50 * weights)
    simulation.step(100)
    # 150 N over 100 steps of 1e-4 s.
    momentum = rise @ (matrices.M_singular @ simulation.velocity)
    assert momentum == pytest.approx(1.5, rel=1e-9)
    simulation.force = 0.0
    simulation.step(100)
    # The load falls to 0 within a step, whose mean is one half of it.
    momentum = rise @ (matrices.M_singular @ simulation.velocity)
    assert momentum == pytest.approx(1.5 + 0.5 * 150 * 1e-4, rel=1e-9)


def test_feedback_damps_the_first_mode(still: rebond.Scene) -> None:
    plucked = still.set("initial.static_pressure=1000", "time.scheme=midpoint", "time.end=0.1")
    model = rebond.Model(plucked)
    modes = model.modes(1)
    omega, ratio = 2 * np.pi * modes.frequencies[0], 0.2
    momentum = model.matrices().M_singular @ modes.shapes[0]
    simulation = rebond.Simulation(plucked, force=0.0)
    start = momentum @ simulation.displacement
    found, expected = [], []
    for step in simulation:
        simulation.force[:] = -2 * ratio * omega * (momentum @ simulation.velocity) * momentum
        found.append(momentum @ simulation.displacement / start)
        # The damped oscillation of one degree of freedom, let go from rest.
        damped = omega * np.sqrt(1 - ratio**2)
        phase = damped * step.time
        decay = np.exp(-ratio * omega * step.time)
        expected.append(decay * (np.cos(phase) + ratio * omega / damped * np.sin(phase)))
    # The velocity is that of the step before, which is late by half a step of 1e-4 s on average.
    assert np.abs(np.array(found) - expected).max() < 2 * ratio * omega * 1e-4
    assert min(found) < -0.3


def test_reactions_hold_the_plate_on_the_floor(fall: rebond.Scene) -> None:
    simulation = rebond.Simulation(fall)
    touched = False
    for step in simulation:
        reactions = simulation.reactions
        assert (reactions >= 0).all()
        assert reactions.sum() == pytest.approx(step.contact_force, rel=1e-12)
        assert np.count_nonzero(reactions) == step.contact_nodes
        touched = touched or step.contact_nodes > 0
    assert touched
    assert (simulation.lower == -0.1).all() and np.isinf(simulation.upper).all()


def test_wrong_loads_are_told(still: rebond.Scene) -> None:
    simulation = rebond.Simulation(still)
    with pytest.raises(rebond.UsageError, match="started without; expected force=0.0"):
        simulation.force[0] = 1
    with pytest.raises(rebond.UsageError, match="found 3 entries; expected 54, one per dof"):
        rebond.Simulation(still, force=[1.0, 2.0, 3.0])
    with pytest.raises(rebond.UsageError, match="entry 0 is NaN; expected finite numbers"):
        rebond.Simulation(still, force=float("nan"))
    with pytest.raises(rebond.UsageError, match="found 2 dimensions"):
        rebond.Simulation(still, force=[[1.0]])
    with pytest.raises(rebond.UsageError, match="expected a count of at least 1"):
        simulation.step(0)
    with pytest.raises(rebond.UsageError, match='time.scheme = "exact" takes loads'):
        rebond.Simulation(still.set("time.scheme=exact"), force=0.0)


def test_an_exception_in_a_load_ends_the_simulation(still: rebond.Scene) -> None:
    def fail(time: float) -> float:
        if time > 5e-4:
            raise LookupError("no such time")
        return 0.0

    simulation = rebond.Simulation(still, force=fail)
    with pytest.raises(LookupError, match="no such time"):
        simulation.step(100)
    with pytest.raises(rebond.UsageError, match="ended with an error; start another"):
        simulation.step()


def test_a_load_cannot_use_its_own_simulation(still: rebond.Scene) -> None:
    held: list[rebond.Simulation] = []
    simulation = rebond.Simulation(still, force=lambda _: held[0].displacement if held else 0.0)
    held.append(simulation)
    with pytest.raises(rebond.UsageError, match="in the midst of a step"):
        simulation.step()


def test_ctrl_c_interrupts_many_steps(still: rebond.Scene) -> None:
    def load(time: float) -> float:
        if time > 0.01:
            signal.raise_signal(signal.SIGINT)
        return 0.0

    simulation = rebond.Simulation(still, force=load)
    with pytest.raises(KeyboardInterrupt):
        simulation.step(10**9)


def test_a_failed_start_is_told(fall: rebond.Scene) -> None:
    with pytest.raises(rebond.Error, match="this build has no"):
        rebond.Simulation(fall.set("solver.engine=petsc"))
