"""Measurements of phasemap: ``phasemap bench``, or ``python -m benchmarks``, in a clone of the repository.

`command` reads what is asked for. Without an option that is time against error (`accuracy`), beside other integrators
and against orbits found by code of its own, with the times of whole `images`, of `curves`, and of what more than an
image costs (`extras`). An option prints the table of a module instead: materials drawn at random (`box`), compilation
(`compile`), scans in time (`scans`), blocks and clusters (`blocks`), named hard cases (`hard`). Nothing of this is in
the wheel, and phasemap imports none of it.
"""
