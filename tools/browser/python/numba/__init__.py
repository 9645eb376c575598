"""What the explorer asks of numba: whether it compiles, which it never does here."""
