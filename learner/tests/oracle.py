"""Fits the canonical policy's potential on the synthetic data of oracle.json, independently of the
learner, and stores mixture and solution there: python oracle.py (needs numpy and cvxpy)."""

import json
import pathlib

import cvxpy as cp
import numpy as np

FILE = pathlib.Path(__file__).with_name("oracle.json")
# config/skills/planar.ron
DAMPING, WIDTH, OVERLAP, SCALE = 8.0, 0.2, 0.6, 0.25
OFFSETS, TUBE_STRIDE, TUBE_WEIGHT, ATTRACTION, SPEED_MIN = (0.06, 0.15, 0.3), 6, 0.05, 2.0, 0.02
DESCENT_WEIGHT, DESCENT_SPEED, SLOWDOWN, ATTRACTION, GOAL_RADIUS, STRIDE = 0.5, 0.3, 0.3, 0.25, 0.2, 4
STIFFNESS_MIN, HESSIAN_MIN, LAMBDA, LENGTH = 6.0, 6.0, 1e-4, 0.3
ITERATIONS, REGULARISATION, RISE = 15, 1e-3, 0.1
N = 3


def ramp(t, rise=RISE):
    """The phase over the time, and its two derivatives."""
    if t > 0.5:
        value, slope, second = ramp(1 - t, rise)
        return 1 - value, slope, -second
    speed, u = 1 / (1 - rise), max(t / rise, 0.0)
    if u >= 1:
        return speed * (t - 0.5 * rise), speed, 0.0
    return (
        speed * rise * u**3 * (1 - 0.5 * u),
        speed * u**2 * (3 - 2 * u),
        speed / rise * 6 * u * (1 - u),
    )


def mixture(paths, count, length):
    """Time-driven Gaussian mixture; the responsibilities."""
    samples = np.concatenate(
        [np.column_stack([np.linspace(0, 1, len(y)) * length, y]) for y in paths]
    )
    fractions = []
    for y in paths:
        arc = np.r_[0, np.cumsum(np.linalg.norm(np.diff(y, axis=0), axis=1))]
        fractions.append(arc / arc[-1])
    piece = np.minimum((np.concatenate(fractions) * count).astype(int), count - 1)
    fraction = np.eye(count)[piece]
    for _ in range(ITERATIONS):
        n = fraction.sum(0)
        means = fraction.T @ samples / n[:, None]
        logs = np.zeros_like(fraction)
        for k in range(count):
            v = samples - means[k]
            c = (v * fraction[:, k : k + 1]).T @ v / n[k] + REGULARISATION * np.eye(samples.shape[1])
            q = np.einsum("ni,ij,nj->n", v, np.linalg.inv(c), v)
            logs[:, k] = np.log(n[k] / len(samples)) - 0.5 * q - 0.5 * np.linalg.slogdet(c)[1]
        logs -= logs.max(1, keepdims=True)
        fraction = np.exp(logs)
        fraction /= fraction.sum(1, keepdims=True)
    return fraction


class Field:
    def __init__(self, means, metrics, width):
        self.means, self.metrics, self.width = means, metrics, width

    def weights(self, s):
        offset = (s - self.means[:, -1]) / self.width
        e = np.exp(-0.5 * (offset**2 - (offset**2).min()))
        w, pull = e / e.sum(), offset / self.width
        return w, w * (w @ pull - pull)

    def basis(self, z):
        """Values and gradients, one a parameter."""
        w, dw = self.weights(z[-1])
        value, gradient = [], []

        def push(k, phi, dphi):
            value.append(w[k] * phi)
            gradient.append(w[k] * np.asarray(dphi, float) + dw[k] * phi * np.eye(N)[-1])

        for k, mean in enumerate(self.means):
            v = z - mean
            if k + 1 < len(self.means):
                push(k, 1.0, np.zeros(N))
                for a in range(N):
                    push(k, v[a], np.eye(N)[a])
            for a in range(N):
                push(k, 0.5 * v[a] ** 2, v[a] * np.eye(N)[a])
                for b in range(a + 1, N):
                    push(k, v[a] * v[b], v[b] * np.eye(N)[a] + v[a] * np.eye(N)[b])
        return np.array(value), np.array(gradient).T

    def metric(self, z):
        w, dw = self.weights(z[-1])
        return np.tensordot(w, self.metrics, 1), np.tensordot(dw, self.metrics, 1)

    def curvature(self, z, v):
        slope = self.metric(z)[1] @ v
        return slope * v[-1] - 0.5 * (slope @ v) * np.eye(N)[-1]


def normals(velocity):
    """Gram–Schmidt from the axis that lies best across what there is."""
    along, across = velocity / np.linalg.norm(velocity), []
    while len(across) < N - 1:
        best = None
        for unit in np.eye(N):
            rest = unit - along * (along @ unit) - sum((n * (n @ unit) for n in across), np.zeros(N))
            if best is None or np.linalg.norm(rest) > np.linalg.norm(best) + 1e-12:
                best = rest
        across.append(best / np.linalg.norm(best))
    return [sign * n for n in across for sign in (1, -1)]


def main():
    oracle = json.loads(FILE.read_text())
    paths = [np.array(p)[:, :2] for p in oracle["points"]]
    rates = [np.array(p)[:, :2] for p in oracle["velocities"]]
    seconds = [np.array(p)[:, :2] for p in oracle["accelerations"]]
    length = np.mean([np.linalg.norm(np.diff(y, axis=0), axis=1).sum() for y in paths])
    goal = np.r_[np.array(oracle["goal"])[:2], length]
    points, velocities, accelerations = [], [], []
    for y, v, a in zip(paths, rates, seconds):
        last = len(y) - 1
        moving = np.linalg.norm(v[1:-1], axis=1) > 0.2
        step = np.linalg.norm(y[2:] - y[:-2], axis=1)[moving] / 2
        per_second = 1 / (last * np.median(step / np.linalg.norm(v[1:-1], axis=1)[moving]))
        phase = np.array([ramp(i / last) for i in range(last + 1)]) * length
        points.append(np.c_[y, phase[:, 0]])
        velocities.append(np.c_[v, phase[:, 1] * per_second])
        accelerations.append(np.c_[a, phase[:, 2] * per_second**2])

    count = oracle["components"]
    fraction = mixture(paths, count, length)
    samples = np.concatenate(points)
    means, metrics, sizes = [], [], []
    for k in range(count):
        mean = fraction[:, k] @ samples / fraction[:, k].sum()
        v = samples - mean
        covariance = (v * fraction[:, k : k + 1]).T @ v / fraction[:, k].sum()
        precision = np.linalg.inv(covariance + WIDTH**2 * np.eye(N))
        means.append(mean)
        metrics.append(SCALE * precision)
        sizes.append(np.linalg.det(precision) ** (1 / N))
    means.append(goal)
    metrics.append(SCALE * np.mean(sizes) * np.eye(N))
    field = Field(np.array(means), np.array(metrics), OVERLAP * length / count)

    def every(path, speeds, stride):
        stride = min(stride, max(len(path) // 10, 1))
        return list(zip(path[::stride], speeds[::stride]))

    demonstrated = [s for p, v in zip(points, velocities) for s in every(p, v, STRIDE)]
    near = np.array([p for p, _ in demonstrated])
    targets = []
    for path, speeds, turns in zip(points, velocities, accelerations):
        for z, v, a in zip(path, speeds, turns):
            targets.append((z, v, a, 1 / (len(path) * len(points))))
        tube = every(path, speeds, TUBE_STRIDE)
        weight = TUBE_WEIGHT / (len(tube) * len(points) * 2 * (N - 1) * len(OFFSETS))
        for z, v in tube:
            if np.linalg.norm(v) <= SPEED_MIN:
                continue
            for n in normals(v):
                for offset in OFFSETS:
                    beside = z + n * offset
                    if np.linalg.norm(near - beside, axis=1).min() > 0.75 * offset:
                        targets.append((beside, v - n * ATTRACTION * offset, np.zeros(N), weight))

    rows, rest, weights = [], [], []
    for z, v, a, weight in targets:
        inverse = np.linalg.inv(field.metric(z)[0])
        rows.append(inverse @ field.basis(z)[1])
        rest.append(DAMPING * v + a + inverse @ field.curvature(z, v))
        weights.append(np.full(N, np.sqrt(weight)))
    rows, rest, weights = np.concatenate(rows), np.concatenate(rest), np.concatenate(weights)

    def direction(z):
        at = np.argmin(((near - z) ** 2).sum(1))
        sample, v = demonstrated[at]
        to_goal = goal - z
        distance = np.linalg.norm(to_goal)
        speed = np.linalg.norm(v)
        forward = v / speed if speed > SPEED_MIN else to_goal / distance
        bent = forward + (sample - z) / ATTRACTION
        bent /= np.linalg.norm(bent)
        close = np.exp(-((distance / GOAL_RADIUS) ** 2))
        t = bent * (1 - close) + to_goal / distance * close
        return t / np.linalg.norm(t), min(distance / SLOWDOWN, 1.0)

    checked = [z for z in near if np.linalg.norm(z - goal) > 1e-6]
    constraints, speeds = [], []
    for z in checked:
        t, part = direction(z)
        constraints.append(np.linalg.inv(field.metric(z)[0]) @ t @ field.basis(z)[1])
        speeds.append(DESCENT_SPEED * DAMPING * part)
    constraints, speeds = np.array(constraints), np.array(speeds)

    p = cp.Variable(rows.shape[1])
    residual = cp.sum_squares(cp.multiply(weights, rows @ p + rest)) / DAMPING**2
    hinge = cp.sum(cp.pos(speeds + constraints @ p)) / len(checked) / DAMPING
    mean_metric = np.mean([np.trace(m) / N for m in field.metrics])
    kinds = ([1.0] + [LENGTH] * N + [LENGTH**2] * 6) * count + [LENGTH**2] * 6
    scales = np.array(kinds) / (mean_metric * DAMPING)
    step = 1e-4
    sides = [
        (field.basis(goal + step * e)[1] - field.basis(goal - step * e)[1]) / (2 * step)
        for e in np.eye(N)
    ]
    hessian = np.stack(sides, 1)
    hessian = 0.5 * (hessian + hessian.transpose(1, 0, 2))
    whiten = np.linalg.inv(np.linalg.cholesky(field.metric(goal)[0]))
    hessian = np.einsum("ai,ijk,bj->abk", whiten, hessian, whiten)
    rules = [field.basis(goal)[1] @ p == 0, p[1 + N + 5] >= 0]
    for i in range(N):
        others = sum(cp.abs(hessian[i, j] @ p) for j in range(N) if j != i)
        rules.append(hessian[i, i] @ p - others >= HESSIAN_MIN)
    at = 0
    for k in range(count + 1):
        at += 1 + N if k < count else 0
        s = [[p[at], p[at + 1]], [p[at + 1], p[at + 3]]]
        at += 6
        white = np.linalg.inv(np.linalg.cholesky(field.metrics[k][:2, :2]))
        entry = lambda a, b: sum(
            white[a, i] * white[b, j] * s[i][j] for i in range(2) for j in range(2)
        )
        trace = entry(0, 0) + entry(1, 1) - 2 * STIFFNESS_MIN
        rules.append(cp.SOC(trace, cp.hstack([entry(0, 0) - entry(1, 1), 2 * entry(0, 1)])))
    objective = residual + DESCENT_WEIGHT * hinge + LAMBDA * cp.sum_squares(cp.multiply(scales, p))
    problem = cp.Problem(cp.Minimize(objective), rules)
    problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)

    random = np.random.default_rng(1)
    probes = samples[random.integers(0, len(samples), 40)] + random.uniform(-0.3, 0.3, (40, N))
    probe_velocities = random.uniform(-1, 1, (40, N))
    probe_accelerations, probe_potentials = [], []
    for z, v in zip(probes, probe_velocities):
        value, gradient = field.basis(z)
        force = gradient @ p.value + field.curvature(z, v)
        probe_accelerations.append(-np.linalg.solve(field.metric(z)[0], force) - DAMPING * v)
        probe_potentials.append(value @ p.value)
    listed = lambda rows: np.round(np.array(rows), 12).tolist()
    FILE.write_text(
        json.dumps(
            {
                "components": count,
                "goal": goal.tolist(),
                "points": [y.tolist() for y in points],
                "velocities": [v.tolist() for v in velocities],
                "accelerations": [a.tolist() for a in accelerations],
                "means": listed(field.means),
                "metrics": listed(field.metrics),
                "parameters": p.value.tolist(),
                "residual": residual.value.item(),
                "hinge": hinge.value.item(),
                "objective": problem.value,
                "probe_points": listed(probes),
                "probe_velocities": listed(probe_velocities),
                "probe_accelerations": listed(probe_accelerations),
                "probe_potentials": listed(probe_potentials),
            }
        )
        + "\n"
    )
    print(problem.status, problem.value, residual.value, hinge.value)


if __name__ == "__main__":
    main()
