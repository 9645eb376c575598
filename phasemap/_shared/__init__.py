"""Tools for every module, which know nothing of the physics.

First comes what is wrong (`errors`, `checks`, `asked`), then what a number is: text with a unit (`quantities`,
`units`), the field of a value object (`fields`), one of an array (`arrays`). Then what the machine has (`memory`,
`files`), how work is spread (`threads`, `processes`) and stopped (`interrupts`), and what the person who called is told
(`notices`). Nothing in here imports from another folder of phasemap except the kernels.
"""
