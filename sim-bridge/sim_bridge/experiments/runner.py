"""Runs all experiments of the arm on all cores and writes what came of them."""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path

from sim_bridge.errors import BridgeError
from sim_bridge.experiments.episode import Experiment, Settings, run_episode
from sim_bridge.experiments.joints import SHORT, cases
from sim_bridge.experiments.page import page
from sim_bridge.experiments.verdict import Verdict, verdicts
from sim_bridge.files import check, make_folder, write

SCHEMA = "tprmp-experiments-arm/1"
RESULT_FILE = "arm.json"
PAGE_FILE = "arm.html"


EXPERIMENTS = (
    Experiment("pick", "ur5", "pick.json", "ur5_pick.ron", 200, 16),
    Experiment("panda", "panda", "pick_panda.json", "panda_pick.ron", 50, 6),
    Experiment("iiwa", "iiwa", "pick_iiwa.json", "iiwa_pick.ron", 50, 6),
    Experiment("adversarial", "ur5", "pick.json", "ur5_pick.ron", 36, 6),
    Experiment("singular", "ur5", "pick.json", "ur5_pick.ron", 32, 4),
    Experiment("joints", "ur5", "pick.json", "ur5_pick.ron", len(cases()), SHORT),
)


def experiments(settings: Settings) -> int:
    """Runs them, writes `arm.json` and `arm.html`; gives the exit code: 1 when a must fails."""
    for file in (settings.controller, settings.model):
        if not file.exists():
            raise BridgeError(f"{file}: no such file: `make experiments-arm` makes it")
    make_folder(settings.out)
    for name in (RESULT_FILE, PAGE_FILE):
        check(settings.out / name, force=settings.force)
    jobs = []
    for experiment in EXPERIMENTS:
        if settings.only and experiment.name not in settings.only:
            continue
        count = experiment.quick_count if settings.quick else experiment.count
        seeds = range(settings.seed, settings.seed + count)
        print(f"{experiment.name}: {count} scenarios, seeds {seeds[0]} to {seeds[-1]}")
        jobs += [(experiment, seed) for seed in seeds]
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix=".running-", dir=settings.out) as running:
        rows = _run(jobs, replace(settings, running=Path(running)))
    order = [experiment.name for experiment in EXPERIMENTS]
    rows.sort(key=lambda row: (order.index(row["experiment"]), row["seed"]))
    found = verdicts(rows)
    took_s = time.monotonic() - began
    traces = [row.pop("trace") for row in rows]
    values = {
        "schema": SCHEMA,
        "quick": settings.quick,
        "took_s": round(took_s, 1),
        "verdicts": [vars(verdict) for verdict in found],
        "rows": rows,
    }
    text = json.dumps(values, indent=1)
    # The folder is this run's by now.
    write(settings.out / RESULT_FILE, text + "\n", force=True)
    html = page(rows, traces, found, quick=settings.quick)
    write(settings.out / PAGE_FILE, html, force=True)
    _print_summary(rows, found, took_s, settings.out)
    return 0 if all(verdict.holds for verdict in found) else 1


def _run(jobs: list[tuple[Experiment, int]], settings: Settings) -> list[dict]:
    rows: list[dict] = []
    on_terminal = sys.stdout.isatty()
    # A process that is spawned has no threads and no shared memory of ours.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(settings.workers, mp_context=context) as pool:
        waiting = [pool.submit(run_episode, settings, *job) for job in jobs]
        try:
            for done in as_completed(waiting):
                row = done.result()
                rows.append(row)
                failed = sum(other["cause"] is not None for other in rows)
                if row["cause"] is not None:
                    start = "\r\033[K" if on_terminal else ""
                    what = f"{row['experiment']}, {row['kind']}, seed {row['seed']}"
                    print(f"{start}  {what}: {row['cause']}")
                if on_terminal or len(rows) % 20 == 0 or len(rows) == len(jobs):
                    end = "" if on_terminal else "\n"
                    start = "\r\033[K" if on_terminal else ""
                    line = f"{start}{len(rows)} of {len(jobs)} done, {failed} not picked in order"
                    print(line, end=end, flush=True)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    if on_terminal:
        print()
    return rows


def _print_summary(rows: list[dict], found: list[Verdict], took_s: float, out: Path) -> None:
    print(f"\n{len(rows)} episodes in {took_s / 60.0:.1f} min")
    for verdict in found:
        holds = "holds" if verdict.holds else "FAILS"
        print(f"  {holds}  {verdict.experiment}: {verdict.must}: {verdict.measured}")
    print(f"results: {out / RESULT_FILE}, report: {out / PAGE_FILE}")


def workers_of_this_machine() -> int:
    """One pair of simulator and controller a core: they take turns."""
    return max(1, len(os.sched_getaffinity(0)))
