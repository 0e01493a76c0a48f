"""The documentation's site: which pages it has, and those that are made from the code.

Each module makes pages as Markdown (MyST) from one part of the code; `site.py` puts them beside the pages that
people write, and Sphinx makes HTML of them. Nothing here is in the wheel.
"""
