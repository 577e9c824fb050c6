"""Experiments of the whole arm: many seeded episodes in lockstep, and a report.

`scenarios` draws what happens, `episode` lets one happen and watches it, `runner` lets all happen
on all cores, `verdict` says what must hold, `page` draws what came of it.
"""
