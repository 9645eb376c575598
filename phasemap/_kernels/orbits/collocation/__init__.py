"""Exact orbits by collocation: polynomials on elements that end where the tip meets the sample.

`elements` lays the elements, `system` has the equations and their derivatives, `newton` solves them. `observables`
makes a row of the solution, `polish` refines until it is as exact as was asked for.
"""
