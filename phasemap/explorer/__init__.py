"""The live explorer: a page in the browser with a slider for every knob of the microscope and the materials.

`subject` is what is explored, `setting` one position of all knobs; `answers` solves a setting by the functions that
any user calls (`phasemap.simulate`, `sweep_distance`, `contrast`), `words` says why the contrast has its sign, and
`saving` writes what was found. `server` speaks HTTP and `explore` starts it.

The page is plain HTML, style and script (folder `page`) over the server of the standard library. Bokeh and Panel were
the other choices: both bring a websocket server and 30 MB and more of packages that need care with each release, and
neither saves any of the drawing here, which is two images and six curves on canvases. This way nothing is installed,
nothing is built, nothing is fetched from elsewhere, and a drag costs what the solvers cost.
"""

__all__: list[str] = []
