"""The live explorer: a page in the browser with a slider for every knob of the microscope and the materials.

`subject` is what is explored, `setting` one position of all knobs; `answers` solves a setting by the functions that
any user calls (`phasemap.simulate`, `sweep_distance`, `contrast`), and `saving` writes what was found. `server` speaks
HTTP and `explore` starts it.
"""
