"""Where a transfer starts and ends: a departure and a target in, states, kernels and tables out.

`spiral` resolves the departure, `halo` and `nrho` make the near-rectilinear halo orbit, `target` hands it on.
"""
