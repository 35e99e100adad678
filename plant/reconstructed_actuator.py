"""The actuators of structures/kiel.toml: voltages of the data sheet, hysteresis and creep of assumed size.

The text of the paper gives no loop. Patches of macro-fibre composite show loops of a width of about a tenth of the
stroke, piezoceramics a creep of about a hundredth in each decade of time. The weights give a loop between -1000 and
1000 V a width of 10.0 % of its stroke, creep 1 % a decade from 10 ms to 1000 s, and the unequal stretching and
shrinking of a patch slopes 5 % steeper above 500 V and 5 % flatter below -500 V. The mean slope between the ends of
the loop is 1 about a second after the voltage is set: that is what piezo_ratio was fitted with.
"""

from flexbeams.plant.actuator.parameters import Actuator, PatchPairActuator

PAIR = PatchPairActuator(
    linear_weight=0.652,
    play_thresholds=[50.0, 100.0, 200.0, 300.0, 400.0, 600.0, 800.0],
    play_weights=[0.071, 0.09, 0.086, 0.062, 0.066, 0.045, 0.023],
    dead_zone_thresholds=[-500.0, 500.0],
    dead_zone_slopes=[-0.05, 0.05],
    creep_times=[0.01, 0.1, 1.0, 10.0, 100.0, 1000.0],
    creep_weights=[0.01, 0.01, 0.01, 0.01, 0.01, 0.01],
    history=[],
)
ACTUATOR = Actuator(
    face_minimum=-500.0, face_maximum=1500.0, supply=500.0, lag=0.0, slew_rate=0.0, resolution=0.0, pair=[PAIR] * 4
)
