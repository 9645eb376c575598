"""A compiler that is not here."""


def watch(_started, _ended):
    """No compiling starts or ends."""
