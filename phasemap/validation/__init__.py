"""Check of an image against what it says of itself: `check` looks at every pixel, and solves it again.

`claims` reads what the file says it is, and `picture` has it in arrays; `invariants` has what must hold in every pixel.
`again` solves all pixels as they were made, and some by another solver, and `agreement` judges what the two find.
"""
