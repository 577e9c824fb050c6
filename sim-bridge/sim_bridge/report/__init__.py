"""The report of a run: `report` writes it.

`figures` judges the log again, `plots` and `pictures` draw, `page` puts it all on one page.
"""
