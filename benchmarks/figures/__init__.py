"""The figures and tables of the papers, made again: `python -m benchmarks figure NAME`.

Each figure is a function of the scale (1 is the paper's size, less is quicker) that returns an `Outcome`: a report,
whose claim holds or not by a stated rule, and a picture. `benchmarks.figures.catalogue` names them all.

matplotlib is the `figures` extra and is imported only inside functions, with the Agg canvas, never a display.
"""
