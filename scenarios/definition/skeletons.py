"""Commented files to begin with: a structure, a scenario and a study that run as they are."""

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

# [actuator]                  # amplifier, hysteresis and creep, for MfcActuator and MfcCompensator; see kiel
# face_minimum = -500.0       # V
# face_maximum = 1500.0       # V
# supply = 500.0              # V
# [[actuator.pair]]           # for each patch pair; `flexbeams identify hysteresis` fits one
# linear_weight = 1.0
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

STUDY = """# {name}: how far the tip mass and the stiffness may be off.
# Values in SI units; `flexbeams schema study --page` explains every key.
title = "{name}"
scenario = "single_beam"      # a shipped name, or a file: mine.toml
method = "lhs"                # or sobol, saltelli (for Sobol indices), grid
runs = 64
seed = 1                      # equal seeds give equal results
stop_time = 3.0               # s
# start."plant.strain_noise_std" = 1e-7    # in every run

[[parameter]]
name = "plant.beam[].tip_mass"
range = [0.9, 1.1]
relative = true               # factors on the scenario's own value

[[parameter]]
name = "plant.beam[].youngs_modulus"
distribution = "truncnorm"    # any of scipy.stats within the variable's bounds
arguments = {{ a = -3.0, b = 3.0, loc = 1.0, scale = 0.03 }}
relative = true
group = "stiffness"           # one input of the sensitivity

# [[parameter]]
# name = "design.weights.lqr_input"        # each value a controller of its own
# values = [5e-3, 1e-2, 2e-2]

[[measure]]                   # as a scenario's checks; limits only mark runs
name = "error at the end"
measure = "end_deviation"
of = "plant.y_pi"
reference = "target"
unit = "m"
max = 2e-4

[[measure]]
name = "largest voltage"
measure = "largest"
of = "controller.u"
unit = "V"

# [signals]                   # kept of each run
# record = ["plant.y_pi"]
# interval = 1e-2             # s
"""

SKELETONS = {"structure": STRUCTURE, "scenario": SCENARIO, "study": STUDY}
