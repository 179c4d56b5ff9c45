"""Moving many robots over one graph of cells without two of them ever in one cell."""
