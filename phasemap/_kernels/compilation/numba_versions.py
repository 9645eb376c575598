"""The versions of numba whose compiler is changed here; any other is refused before it compiles anything."""

FIRST, BEYOND = (0, 61), (0, 69)  # those of pyproject.toml: the first that works, and the first that nobody has tried


def check_numba() -> None:
    """Raise ImportError if numba is of another version."""
    import numba

    if not FIRST <= numba.version_info.short < BEYOND:
        first, beyond = (".".join(map(str, one)) for one in (FIRST, BEYOND))
        raise ImportError(
            f"phasemap works with numba from {first} on and before {beyond}, whose compiler it changes, and numba "
            f"{numba.__version__} is installed: pip install 'numba>={first},<{beyond}'."
        )
