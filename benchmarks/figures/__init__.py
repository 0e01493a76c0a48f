"""Reproduced figures and tables of the papers: `python -m benchmarks figure NAME`.

Each figure is a function of the scale (1: size of the paper; less: quicker) that returns an `Outcome`: a picture,
and a report whose claim a stated rule confirms or rejects. `benchmarks.figures.catalogue` names all figures.

matplotlib is the `figures` extra. It is imported only inside functions, with the Agg canvas, which needs no
display.
"""
