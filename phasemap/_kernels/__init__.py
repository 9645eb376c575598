"""Compiled code. Units, names and files are unknown here: float64 arrays in, float64 arrays and status codes out.

`law`, `columns`, `quadrature`, `neck_energy`, `lever` and `lever_modes` are what all others stand on; `orbits` says
what an orbit is, `continuation` follows one as something changes, `engagement` says which orbit a tip from far ends on.
`rows` has the loops over materials that Python calls, `scanning` the tip that moves on, `materials` what is known of
neighbours.

Words that are the same everywhere:

* lengths are in m, and forces over the lever's stiffness, so that P and S (push, drag) [m] are the parts of the force
  in phase and out of phase with the tip; times are tau = omega_c t;
* `p`: a material's parameters for its law, `row`: a result row (`columns`), `u` or `y`: a state in time;
* `reach`: distance over which the long-range force changes [m]; `centre`: height of an orbit's middle over the surface;
* c: that over A, so that a harmonic orbit just touches at c = 1; `mismatch`: drive that such an orbit needs over the
  drive that there is, squared, less one: 0 on an averaged orbit;
* `top`: the maximum of the mismatch as the tip comes near, behind which the repulsive side begins;
* `seen`: what the detector shows, where that is not the tip's motion;
* `hold`: what stays the same while an orbit is sought; `level`: of refinement of its elements in time;
* m: the parameter of a sweep, -1 to 1; in `orbits.time` what a surface remembers, whose elements lie at xi = q^2 [m], q
  the edge of the contact; `arms`: its relaxing springs with their dashpots; `dent`: what a tap leaves of its depth;
* `workspace`: records and arrays that are used again for every material, and hold the orbit found.
"""

from phasemap._kernels import loaded_sources as loaded_sources  # before any kernel, to know what is loaded
