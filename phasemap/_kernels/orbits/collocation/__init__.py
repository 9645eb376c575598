"""Exact orbits by collocation: polynomials on elements that end where the tip meets the sample.

`contacts_and_necks` finds where the tip meets the sample and necks break, `elements` lays the elements between,
`system` holds the motion on them, `lever_over_element` how the lever moves, `linearised` the equations and their
derivatives, `closing` adds the drive and what is held (`held_equation`) and takes a step, `newton` takes steps until
all hold, on a `path` along which law and lever may change. They begin at a harmonic orbit. `observables` makes a row of
the solution, `stability` says whether the motion stays there, `errors` how wrong the row is, `near` goes from a
harmonic orbit to one whose energy closes.
"""
