"""Of scipy, the page needs one function."""
