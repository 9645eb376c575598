"""Exact orbits by the lever's response: the motion is what the force at a set of nodes makes of it.

`nodes` places the nodes and has the force at them, `motion` the lever's response to it, `passes` iterates the two,
`newton_pass` takes their place where they contract slowly, `state` has what is known of the orbit, `errors` what is
stated of it, `stability` says whether it can be held, `apex` treats the turning of the tip within the sample.
`orbit_at_setpoint` puts them together, from an averaged guess to a row.
"""
