"""The thesis' two programs, solved by other means than the learner's, on made-up demonstrations.

Writes `thesis_oracle.json`, which `thesis_oracle.rs` compares the learner with:

    python -m venv target/oracle
    target/oracle/bin/pip install numpy==2.4.6 cvxpy==1.9.3 ecos==2.0.14 highspy==1.16.0
    target/oracle/bin/python learner/tests/thesis_oracle.py

Two demonstrations in the plane, each seen from two frames that lie differently. Products of
Gaussians are taken by covariances, gradients and curvature by complex steps; the cone program is
solved by ECOS, the linear ones by HiGHS. Equation numbers are those of the thesis.
"""

import json
from pathlib import Path

import cvxpy as cp
import numpy as np

METRIC_SCALE = 0.25
HUBER_THRESHOLD = 2.0
DAMPING_MIN = 0.1
# Slower samples show no direction: fraction of the demonstration's largest speed.
SPEED_FRACTION_MIN = 0.02
STEP_S = 0.05
SAMPLES = 41
GOAL = np.array([0.6, 0.3])
# Fraction of the path, and standard deviations along and across it seen from start and end [m].
COMPONENTS = [
    (0.05, (0.10, 0.04), (0.22, 0.15)),
    (0.3, (0.14, 0.06), (0.20, 0.12)),
    (0.36, (0.07, 0.15), (0.08, 0.14)),
    (0.6, (0.18, 0.11), (0.15, 0.07)),
    (0.97, (0.24, 0.16), (0.11, 0.04)),
]
# Bulge of the way [m], and angle and origin of start and end frame.
DEMONSTRATIONS = [
    (0.12, (0.0, [0.0, 0.0]), (0.0, [0.6, 0.3])),
    (0.17, (0.3, [0.05, -0.04]), (-0.2, [0.66, 0.24])),
]


def rotation(angle):
    """Matrix of a turn in the plane."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def bow(fraction, bulge, start, goal):
    """Point of a bow from start to goal, and its derivative by the fraction."""
    along = goal - start
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    point = start + along * fraction + across * bulge * np.sin(np.pi * fraction)
    return point, along + across * bulge * np.pi * np.cos(np.pi * fraction)


def rounded(values):
    """Numbers as the fixture stores them."""
    return np.round(np.asarray(values), 6)


def made_up():
    """Gaussians of each frame, and demonstrations with their frames."""
    frames = []
    for origin, spread in [(np.zeros(2), 1), (GOAL, 2)]:
        means, covariances = [], []
        for component in COMPONENTS:
            point, tangent = bow(component[0], 0.14, np.zeros(2), GOAL)
            axes = rotation(np.arctan2(tangent[1], tangent[0]))
            covariance = axes @ np.diag(np.square(component[spread])) @ axes.T
            means.append(rounded(point - origin))
            covariances.append(rounded((covariance + covariance.T) / 2))
        frames.append((means, covariances))
    demonstrations = []
    for bulge, *placed in DEMONSTRATIONS:
        points, velocities = [], []
        duration = (SAMPLES - 1) * STEP_S
        for i in range(SAMPLES):
            t = i / (SAMPLES - 1)
            fraction = t**3 * (10 - 15 * t + 6 * t**2)
            rate = 30 * t**2 * (1 - t) ** 2 / duration
            point, slope = bow(fraction, bulge, np.array(placed[0][1]), np.array(placed[1][1]))
            points.append(rounded(point))
            velocities.append(rounded(slope * rate))
        demonstrations.append((placed, points, velocities))
    return frames, demonstrations


def product(frames, placed):
    """Eq. 3.6: means and covariances of the products in the world."""
    means, covariances = [], []
    for k in range(len(COMPONENTS)):
        information, weighted = np.zeros((2, 2)), np.zeros(2)
        for (local_means, local_covariances), (angle, origin) in zip(frames, placed):
            turn = rotation(angle)
            inverse = np.linalg.inv(turn @ local_covariances[k] @ turn.T)
            information += inverse
            weighted += inverse @ (turn @ local_means[k] + origin)
        covariances.append(np.linalg.inv(information))
        means.append(covariances[-1] @ weighted)
    return np.array(means), np.array(covariances)


class Field:
    """Potential, metric and weights of products in the world, at real or complex points."""

    def __init__(self, means, covariances):
        """Takes the products."""
        self.means = means
        self.precisions = np.linalg.inv(covariances)
        self.volumes = np.sqrt(np.linalg.det(2 * np.pi * covariances))

    def squares(self, x):
        """n_k² of all components."""
        away = x - self.means
        return np.einsum("ki,kij,kj->k", away, self.precisions, away)

    def weights(self, x):
        """Eq. 4.6."""
        densities = np.exp(-0.5 * self.squares(x)) / self.volumes
        return densities / densities.sum()

    def local_potentials(self, x):
        """Eq. 4.11 without the bias potentials."""
        squares = self.squares(x)
        outside = HUBER_THRESHOLD * (np.sqrt(squares) - HUBER_THRESHOLD / 2)
        return np.where(squares.real <= HUBER_THRESHOLD**2, squares / 2, outside)

    def potential(self, x, biases):
        """Eq. 4.10."""
        return self.weights(x) @ (biases + self.local_potentials(x))

    def metric(self, x):
        """Eq. 4.5."""
        return METRIC_SCALE * np.einsum("k,kij->ij", self.weights(x), self.precisions)

    def gradient(self, x, biases):
        """Eq. 4.12, as the derivative of eq. 4.10."""
        return derivative(lambda x: self.potential(x, biases), x)

    def curvature(self, x, velocity):
        """Eq. 4.7-4.9: the rate of M ẋ for a constant ẋ, less half the slope of ẋᵀMẋ."""
        momentum_rate = derivative(lambda x: self.metric(x) @ velocity, x) @ velocity
        return momentum_rate - 0.5 * derivative(lambda x: velocity @ self.metric(x) @ velocity, x)


def derivative(function, x):
    """Derivatives along the axes, by complex steps; the last index is the axis."""
    step = 1e-30
    return np.stack([function(x + 1j * step * e).imag / step for e in np.eye(2)], axis=-1)


def solve_potential(demonstrated):
    """Eq. 4.15-4.16: bias potentials and mean residual."""
    free = cp.Variable(len(COMPONENTS))
    norms = []
    for field, points, velocities in demonstrated:
        speeds = np.linalg.norm(velocities, axis=1)
        for x, velocity, speed in zip(points, velocities, speeds):
            if speed <= SPEED_FRACTION_MIN * speeds.max():
                continue
            inverse = np.linalg.inv(field.metric(x))
            constant = field.gradient(x, np.zeros(len(COMPONENTS)))
            slope = derivative(field.weights, x).T
            norms.append(cp.norm(velocity / speed + inverse @ (constant + slope @ free)))
    falling = [free[:-1] >= free[1:], free[-1] >= 0]
    problem = cp.Problem(cp.Minimize(sum(norms) / len(norms)), falling)
    problem.solve(solver=cp.ECOS, abstol=1e-9, reltol=1e-9, feastol=1e-9)
    # Only differences count: the last one is zero.
    return free.value - free.value[-1], problem.value


def energy_rows(demonstrated, biases, whole_profile):
    """Eq. 4.18-4.19: (weight, energy lost, energy dissipated per unit of each damping)."""
    rows = []
    for field, points, velocities in demonstrated:
        energies = [
            0.5 * v @ field.metric(x) @ v + field.potential(x, biases)
            for x, v in zip(points, velocities)
        ]
        powers = [field.weights(x) * (v @ v) * STEP_S for x, v in zip(points, velocities)]
        if whole_profile:
            for t, energy in enumerate(energies):
                dissipated = np.sum(powers[:t], axis=0) if t else np.zeros(len(COMPONENTS))
                rows.append((1 / len(points), energies[0] - energy, dissipated))
        else:
            rows.append((1.0, energies[0], np.sum(powers, axis=0)))
    return rows


def solve_damping(rows):
    """Eq. 4.20-4.21: of the dampings with the least mean error, those of the least squares.

    Of the total energy only the error is compared: which solution is found is open. The error is relative to the largest energy that is lost.
    """
    weights, lost, dissipated = (np.array(column) for column in zip(*rows))
    scale = 1 / (np.abs(lost).max() * weights.sum())
    damping = cp.Variable(len(COMPONENTS))
    error = scale * cp.sum(cp.multiply(weights, cp.abs(lost - dissipated @ damping)))
    rising = [damping[0] >= DAMPING_MIN, damping[1:] >= damping[:-1]]
    least = cp.Problem(cp.Minimize(error), rising)
    least.solve(solver=cp.HIGHS)
    # An interior point method needs some room.
    best = [*rising, error <= least.value + 1e-8]
    cp.Problem(cp.Minimize(cp.norm(damping)), best).solve(solver=cp.ECOS)
    return damping.value, least.value


def main():
    """Solves everything and writes the fixture."""
    frames, demonstrations = made_up()
    demonstrated, stored = [], []
    for placed, points, velocities in demonstrations:
        field = Field(*product(frames, placed))
        demonstrated.append((field, np.array(points), np.array(velocities)))
    biases, potential_objective = solve_potential(demonstrated)
    # The total energy of one demonstration is one equation: there many solutions are as good.
    damping = [
        (target, count, *solve_damping(energy_rows(demonstrated[:count], biases, whole_profile)))
        for target, count, whole_profile in [
            ("TotalEnergy", 1, False),
            ("TotalEnergy", 2, False),
            ("EnergyProfile", 2, True),
        ]
    ]
    random = np.random.default_rng(5)
    for (placed, _, _), (field, points, velocities) in zip(demonstrations, demonstrated):
        probes = []
        for _ in range(8):
            x = rounded(GOAL * random.uniform(-0.3, 1.3) + random.uniform(-0.3, 0.3, 2))
            v = rounded(random.uniform(-1, 1, 2))
            probes.append(
                {
                    "point": x,
                    "velocity": v,
                    "weights": field.weights(x),
                    "potential": field.potential(x, biases),
                    "gradient": field.gradient(x, biases),
                    "metric": field.metric(x),
                    "curvature": field.curvature(x, v),
                }
            )
        stored.append(
            {
                "frames": [{"angle_rad": angle, "origin_m": origin} for angle, origin in placed],
                "points": points,
                "velocities": velocities,
                "means": field.means,
                "precisions": field.precisions,
                "probes": probes,
            }
        )
    oracle = {
        "metric_scale": METRIC_SCALE,
        "huber_threshold": HUBER_THRESHOLD,
        "damping_min": DAMPING_MIN,
        "step_s": STEP_S,
        "frames": [{"means": m, "covariances": c} for m, c in frames],
        "demonstrations": stored,
        "potentials": biases,
        "potential_objective": potential_objective,
        "damping": [
            {"target": target, "demonstrations": count, "damping": d, "objective": objective}
            for target, count, d, objective in damping
        ],
    }
    path = Path(__file__).with_suffix(".json")
    text = json.dumps(oracle, default=lambda array: array.tolist())
    path.write_text(text.replace("}, {", "},\n{").replace("], [", "],\n["), encoding="utf-8")
    print(f"φ⁰ = {biases}, residual {potential_objective}")
    for target, count, d, objective in damping:
        print(f"{target} of {count}: d = {d}, error {objective}")
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
