"""Commented files to begin with: a structure and a scenario that run as they are."""

STRUCTURE = """# {name}: one beam with one pair of patches and two strain gauges.
# All values in SI units; `flexbeams schema structure --page` explains every key.

[[beam]]                      # in order; further beams follow as further [[beam]] tables
length = 0.40                 # m
width = 0.045                 # m
thickness = 0.8e-3            # m
density = 1500.0              # kg/m3
youngs_modulus = 6.0e10       # Pa
tip_mass = 0.025              # kg
viscous_damping = 0.025       # N s/m2
structural_damping = 4e-3     # N s

[[patch]]                     # a pair: one patch on each side of the beam
beam = 1
position = 0.025              # m, start of the pair from the clamp
length = 0.085                # m
width = 0.025                 # m
thickness = 0.3e-3            # m
density = 5440.0              # kg/m3
youngs_modulus = 3.03e10      # Pa
viscous_damping = 0.025       # N s/m2
structural_damping = 4e-3     # N s
piezo_ratio = 24.0            # C/m2, about 2 d33 E
electrode_distance = 5e-4     # m

# [[spring]]                  # between the tips of two adjacent beams
# between = [1, 2]
# stiffness = 5.0             # N/m

[[point_of_interest]]         # where the deflection is controlled
beam = 1
position = 0.39               # m

[[strain_gauge]]              # at least as many as there are modes to tell apart
beam = 1
position = 0.0675             # m, centre
length = 0.006                # m

[[strain_gauge]]
beam = 1
position = 0.2
length = 0.006
"""

SCENARIO = """# {name}: the tip moves by 2 mm and stays there.
# Times in s, values in SI units; `flexbeams schema scenario --page` explains every key.
title = "{name}"
structure = "single_beam"     # a shipped name, or a file: rig.toml
stop_time = 2.0               # s

# [design]                    # options of the design, such as
# observer = "offset_free"

[instance.feedforward]        # units step in this order
unit = "FlatnessFeedforward"
start.transition_time = 0.8   # s
start.preview = 2e-4          # s, compensates the delay of one sample

[instance.controller]
unit = "TrackingController"

[instance.plant]
unit = "BeamPlant"
# start."beam[1].tip_mass" = 0.03
# scale."beam[].youngs_modulus" = 1.05

[[connection]]                # arrays of equal size
from = "feedforward.u_ff"
to = "controller.u_ff"
[[connection]]
from = "feedforward.x_ref"
to = "controller.x_ref"
[[connection]]
from = "controller.u"
to = "plant.u"
[[connection]]
from = "plant.y_pm"
to = "controller.y_pm"

[[input]]                     # a signal: constant, step, pulse, chirp, pseudo_random, table or targets
to = "feedforward.y_target"
targets = [{{ time = 0.2, value = [2e-3] }}]

[[check]]                     # measured on the recorded signals; without limits it only reports
name = "error at the end"
measure = "end_deviation"
of = "plant.y_pi"
reference = "target"
unit = "m"
max = 2e-5

[[figure]]                    # drawn as PNG and SVG, and in the report
file = "motion"
rows = [["feedforward.y_ref", "plant.y_pi"], ["plant.u"]]
"""

SKELETONS = {"structure": STRUCTURE, "scenario": SCENARIO}
