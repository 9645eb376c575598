"""Images beside each other: levelled, registered, brought to one grid, and scored.

`registration` finds how far two images are shifted, and `pair` brings them to one grid. `scores` are numbers of how
much alike they are; `result` is `phasemap.compare`, which puts all this together, and `findings` says what it found.
"""
