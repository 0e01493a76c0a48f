"""Command line: parse arguments, call the library, show results. No results are computed here."""
