"""The fit of the planar simulator: its compiled objective, the run from event to event, and the minimisation."""

from dataclasses import replace

import numpy as np
import pytest

from nsdr import Event
from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.physics import collision_search
from nsdr.dynamics.physics.bodies import OUTLINE_POINTS, outline_of
from nsdr.dynamics.physics.body_state import POSITION, VELOCITY, YAW
from nsdr.dynamics.physics.collision_search import search_collisions
from nsdr.dynamics.physics.cube_edges import EDGES_PX, box_edges_px, projection_rows
from nsdr.dynamics.physics.fit_objective import (
    EDGE_NOISE_PX,
    LOG_MASS,
    PAIR_REBOUND,
    POSITION_NOISE_WORLD,
    REBOUND,
    ROBUST_SCALE,
    evaluate,
)
from nsdr.dynamics.physics.simulator import NO_CONTACT, BodyStates, Perturbations, simulate
from nsdr.dynamics.physics.solver import trust_region_step
from nsdr.dynamics.physics.trajectory_fit import REBOUND_DEVIATION, _Problem, fit_trajectories
from nsdr.dynamics.sliding import slide_one
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import CLEVRER_WORLD

from .test_dynamics import LAWS
from .test_physics import bodies, run, seen

CUBE = bodies(("cube", 0.0, 0.0, 0.0, 0.0)).body[0]

PAIRS = {
    "spheres": bodies(("sphere", -1.5, 0.12, 2.4, 0.0), ("sphere", 0.0, 0.0, 0.0, 0.0)),
    "two cylinders": bodies(("cylinder", -0.9, 0.1, 1.6, 0.0), ("cylinder", 0.0, 0.0, 0.0, 0.0)),
    "a cylinder": bodies(("sphere", -1.5, 0.05, 2.4, 0.0), ("cylinder", 0.0, 0.0, 0.0, 0.0)),
    "a cube that spins": bodies(("sphere", -1.5, 0.15, 2.4, 0.0), ("cube", 0.0, 0.0, 0.0, 0.0)),
    "two cubes": bodies(("cube", -1.2, 0.1, 2.4, 0.2), ("cube", 0.0, 0.0, 0.0, 0.0), yaw=0.5),
}


def outline_px(position: np.ndarray, yaw: float) -> np.ndarray:
    """Left and right edge of a cube's image, by projecting all corners of its hull."""
    c, s = np.cos(yaw), np.sin(yaw)
    ring = outline_of(CLEVRER.shape("cube")) @ np.array([[c, s], [-s, c]]) + position
    hull = np.concatenate([np.c_[ring, np.full(len(ring), z)] for z in (0.0, 0.4)])
    columns = CLEVRER_CAMERA.pixels(hull)[:, 0]
    return np.array([columns.min(), columns.max()]) + EDGES_PX


def measured(start: BodyStates, rebound: float = 0.4, frames: int = 60) -> tuple[MotionStates, Event]:
    """A run as a tracker measures it, cubes' edges included, and its collision."""
    motion = run(start, frames, rebound=np.full((2, 2), rebound))
    states = seen(motion, start.body)
    rng = np.random.default_rng(1)
    for i in np.flatnonzero(start.body["is_box"]):
        edges = np.array([outline_px(row[POSITION], row[YAW]) for row in motion.states[i]])
        edges += rng.normal(size=edges.shape)
        states.box_px[i, :, 0], states.box_px[i, :, 2] = edges.mean(1), edges[:, 1] - edges[:, 0]
    return states, Event("collision", int(motion.contacts[0, 0, 1]), (0, 1))


def problem_near(name: str) -> tuple[_Problem, np.ndarray]:
    """A problem, and parameters a little beside its solution."""
    states, collision = measured(PAIRS[name])
    problem = _Problem(states, [collision])
    x = problem.solve_with_restarts(problem.start(), problem.frames)
    return problem, x + 0.3 * np.random.default_rng(2).normal(size=len(x))


@pytest.mark.parametrize("shape", CLEVRER.words["shape"])
@pytest.mark.parametrize(("speed", "seconds"), [(2.8, 0.7), (0.2, 3.0), (1.0, -0.4)])
def test_the_law_of_sliding_knows_its_derivatives(shape: str, speed: float, seconds: float) -> None:
    law, step = LAWS[shape], 1e-5
    distance, final, by_speed, final_by_speed = slide_one(law, speed, seconds)
    above, below = slide_one(law, speed + step, seconds), slide_one(law, speed - step, seconds)
    assert by_speed == pytest.approx((above[0] - below[0]) / (2 * step), abs=1e-5)
    assert final_by_speed == pytest.approx((above[1] - below[1]) / (2 * step), abs=1e-5)
    back = slide_one(law, final, -seconds)
    if final > 0:
        assert (-back[0], back[1]) == pytest.approx((distance, speed), abs=1e-9)


@pytest.mark.parametrize("name", PAIRS)
def test_the_gradient_is_that_of_the_cost(name: str) -> None:
    problem, x = problem_near(name)
    _, gradient, curvature, _, contact = evaluate(problem.problem, x, problem.frames)
    step = 1e-4 * np.eye(len(x))
    above = np.array([evaluate(problem.problem, x + d, problem.frames)[0] for d in step])
    below = np.array([evaluate(problem.problem, x - d, problem.frames)[0] for d in step])
    assert contact[0, 1] != NO_CONTACT
    np.testing.assert_allclose(gradient, (above - below) / 2e-4, atol=1e-4 * np.abs(gradient).max())
    assert np.linalg.eigvalsh(curvature).min() > 0


@pytest.mark.parametrize("name", PAIRS)
def test_the_cost_is_the_mean_robust_loss_of_all_residuals(name: str) -> None:
    problem, x = problem_near(name)
    cost, _, _, motion, _ = evaluate(problem.problem, x, 40)
    residuals = []
    states = problem.states
    for i, body in enumerate(problem.body):
        for row, position, box, weight in zip(
            motion[i], states.location_world[i], states.box_xyxy_px[i], states.weight[i], strict=False
        ):
            residuals += (np.sqrt(weight) * (row[POSITION] - position) / POSITION_NOISE_WORLD).tolist()
            if body["is_box"]:
                off = (outline_px(row[POSITION], row[YAW]) - box[[0, 2]]) / EDGE_NOISE_PX
                residuals += (np.sqrt(weight) * off).tolist()
    for value, kind in zip(x * problem.unit, problem.problem.parameters[:, 0], strict=True):
        if kind == LOG_MASS:
            residuals.append(value / CLEVRER_WORLD.physics.log_mass_std)
        elif kind == PAIR_REBOUND:
            residuals.append((value - 0.64 * REBOUND) / REBOUND_DEVIATION)
    loss = ROBUST_SCALE**2 * (np.sqrt(1 + (np.array(residuals) / ROBUST_SCALE) ** 2) - 1)
    assert cost == pytest.approx(loss.mean(), rel=1e-9)


def test_edges_are_found_from_any_start_of_the_climb() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        position, yaw = rng.uniform(-2, 2, 2), float(rng.uniform(-4, 4))
        start = rng.integers(0, OUTLINE_POINTS, (2, 2))
        edges = box_edges_px(projection_rows(CLEVRER_CAMERA), CUBE, *position, yaw, start, np.empty((2, 3)))
        np.testing.assert_allclose(edges, outline_px(position, yaw), atol=1e-6)


@pytest.mark.parametrize("name", PAIRS)
def test_event_to_event_is_as_step_by_step(name: str) -> None:
    states, collision = measured(PAIRS[name])
    fit = fit_trajectories(states, [collision])
    stepped = simulate(fit.bodies, np.ones(2, bool), 60, fit.rebound)
    assert abs(stepped.contacts[0, 0, 1] - fit.contact[0, 1]) <= 1
    np.testing.assert_allclose(stepped.states[..., POSITION], fit.states[..., POSITION], atol=0.02)


def test_objects_that_press_on_each_other_come_to_an_end() -> None:
    start = bodies(("sphere", -1.0, 0.0, 2.0, 0.0), ("cube", 0.0, 0.0, 0.0, 0.0), yaw=0.01)
    states, collision = measured(start, rebound=0.0)
    fit = fit_trajectories(states, [collision])
    assert fit.states[1, 40, 2] > 0.5  # the sphere, which nothing slows down, pushes the cube
    errors = np.linalg.norm(fit.states[..., POSITION] - states.location_world, axis=-1)
    assert np.median(errors, axis=1).max() < 0.02


def test_steps_stay_within_the_trust_region() -> None:
    rng = np.random.default_rng(0)
    root, gradient = rng.normal(size=(12, 12)), rng.normal(size=12)
    curvature = root @ root.T
    free = trust_region_step(gradient, curvature, 1e6)
    np.testing.assert_allclose(free, -np.linalg.solve(curvature, gradient), rtol=1e-5)
    bound = trust_region_step(gradient, curvature, 0.1)
    assert np.linalg.norm(bound) == pytest.approx(0.1, rel=0.11)
    multiplier = -(gradient + curvature @ bound) @ bound / (bound @ bound)
    np.testing.assert_allclose((curvature + multiplier * np.eye(12)) @ bound, -gradient, atol=1e-6)


def test_a_fit_starts_from_another() -> None:
    states, collision = measured(PAIRS["a cylinder"])
    first = fit_trajectories(states, [])
    assert fit_trajectories(states, [collision], start=first).cost <= first.cost
    good = fit_trajectories(states, [collision])
    again = fit_trajectories(states, [collision], start=good)
    assert again.cost == pytest.approx(good.cost, rel=0.01)


def test_perturbed_runs_are_those_of_perturbed_bodies() -> None:
    start, rng = PAIRS["a cube that spins"], np.random.default_rng(0)
    noise = rng.normal(size=(4, 2, 6)) * [0.02, 0.02, 0.1, 0.1, 0.3, 0.0]
    changes = Perturbations(noise[:, :, None], rng.uniform(0.8, 1.2, (4, 2)))
    motion = simulate(start, np.ones(2, bool), 60, perturbations=changes)
    np.testing.assert_array_equal(motion.states, run(start, 60).states)
    noise[~start.state[:, VELOCITY].any(1)[None].repeat(4, 0), VELOCITY] = 0.0
    for k in range(4):
        changed = replace(start, state=start.state + noise[k], mass=start.mass * changes.mass[k])
        np.testing.assert_array_equal(motion.contacts[k + 1], run(changed, 60).contacts[0])


def test_a_probable_collision_that_the_fitted_objects_make_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its first fit was stuck, it was dropped, and the run without it makes it all the same."""
    states, collision = measured(PAIRS["spheres"])
    fit, calls = fit_trajectories(states, [collision]), []

    def fitted(states, collisions, restarts, start):
        calls.append((len(collisions), start is not None))
        touches, cost = {(1, False): (False, 0.56), (0, False): (True, 0.14), (1, True): (True, 0.12)}[calls[-1]]
        return replace(fit, contact=np.full((2, 2), 30 if touches else NO_CONTACT), cost=cost)

    monkeypatch.setattr(collision_search, "fit_trajectories", fitted)
    found, chosen, _ = search_collisions(states, [(collision, 0.9)])
    assert [e.objects for e in found] == [(0, 1)]
    assert chosen.cost == 0.12
    assert calls == [(1, False), (0, False), (1, True)]
