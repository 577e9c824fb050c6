"""Experiments of the whole arm: many seeded episodes in lockstep, and a report.

`scenarios` draws what happens, `episode` runs one scenario and watches it, `runner` runs all of
them on all cores, `verdict` says what must hold, `page` draws what came of it.
"""
