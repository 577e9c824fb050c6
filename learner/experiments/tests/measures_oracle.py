"""The field's measures of the likeness of two curves, by PyPI's `similaritymeasures`.

Writes `measures_oracle.json`, which `measures_oracle.rs` compares the experiments' measures with:

    python -m venv target/oracle
    target/oracle/bin/pip install numpy==2.4.6 scipy==1.17.1 similaritymeasures==1.5.0
    target/oracle/bin/python learner/experiments/tests/measures_oracle.py

Pairs of random curves in the plane and in space, smooth ones and random walks, of the same and of
different numbers of points. Areas and what compares by time need the same number; areas the plane.
"""

import json
from pathlib import Path

import numpy as np
import similaritymeasures

SEED = 20
STEP_S = 0.02
# Points of both curves, dimensions, and the largest size of a curve [m].
PAIRS = [
    (40, 40, 2, 1.0),
    (60, 60, 2, 0.05),
    (25, 25, 2, 3.0),
    (2, 2, 2, 1.0),
    (30, 47, 2, 1.0),
    (80, 33, 2, 0.05),
    (1, 20, 2, 1.0),
    (35, 35, 3, 0.5),
    (50, 21, 3, 1.0),
]


def smooth(random, count, dimensions):
    """A sum of a few waves."""
    times = np.linspace(0.0, 1.0, count)[:, None]
    waves = range(1, 4)
    amplitudes = [random.normal(size=dimensions) / k for k in waves]
    phases = [random.uniform(0.0, 2.0 * np.pi, size=dimensions) for _ in waves]
    return sum(
        a * np.sin(np.pi * k * times + p) for k, a, p in zip(waves, amplitudes, phases, strict=True)
    )


def walk(random, count, dimensions):
    """A random walk: it crosses itself and the other curve."""
    return np.cumsum(random.normal(size=(count, dimensions)), axis=0) / np.sqrt(count)


def expected(a, b):
    """All measures that these curves have."""
    result = {
        "dtw": similaritymeasures.dtw(a, b)[0],
        "frechet": similaritymeasures.frechet_dist(a, b),
    }
    if len(a) == len(b):
        dimensions = a.shape[1]
        velocities = [np.diff(curve, axis=0) / STEP_S for curve in (a, b)]
        result["mean_square"] = dimensions * similaritymeasures.mse(a, b)
        result["velocity_rmse"] = np.sqrt(dimensions * similaritymeasures.mse(*velocities))
        if dimensions == 2:
            result["swept_area"] = similaritymeasures.area_between_two_curves(a, b)
    return result


def main():
    """Draws the curves and writes the fixture."""
    random = np.random.default_rng(SEED)
    pairs = []
    for count_a, count_b, dimensions, size in PAIRS:
        for draw in (smooth, walk):
            a, b = (
                np.round(size * draw(random, count, dimensions), 9) for count in (count_a, count_b)
            )
            pairs.append({"a": a.tolist(), "b": b.tolist(), **expected(a, b)})
    path = Path(__file__).with_suffix(".json")
    text = json.dumps({"step_s": STEP_S, "pairs": pairs}, default=float)
    path.write_text(text.replace("}, {", "},\n{").replace("], [", "],\n["), encoding="utf-8")
    print(f"wrote {path}: {len(pairs)} pairs")


if __name__ == "__main__":
    main()
