# SPDX-License-Identifier: Apache-2.0
"""
Write the files of the tutorial from_files.md: six drives and a night of a car, and a track of its drive to work.

The logs have one reading a line, as an app writes them. The battery has cells in a core and a shell (235 and 100
kJ/K, 600 W/K between them), its sensor is on the shell, which the coolant warms late. The heater's efficiency is
0.9; at stand the battery loses 9 W/K.
"""

from datetime import datetime, timedelta
from math import cos, exp, pi, sin
from random import Random

RANDOM = Random(1)


def write_log(path, seconds, temperature_c, air_c, heats_from_s=0, heats_to_s=0, drives=True):
    """Write a log of a drive or a night."""
    core_c = shell_c = temperature_c
    soc, late_w, rows = 0.86, 0.0, []
    for s in range(seconds):
        begun = min(1.0, min(s, seconds - s) / 40)
        v = begun * (20 + 9 * sin(s / 180) + 4 * sin(s / 37)) if drives else 0.0
        power_w = 400 * drives + 0.35 * v**3 + 180 * v + 250 * v * sin(s / 13)
        heater_w = 5500.0 if heats_from_s <= s < heats_to_s else 0.0
        open_v, ohm = 350 + 60 * soc, 0.13 * exp(-0.02 * (core_c - 10))
        current_a = (power_w + heater_w) / (open_v - ohm * (power_w + heater_w) / open_v)
        late_w += (0.9 * heater_w - late_w) / 60
        between_w = 600 * (shell_c - core_c)
        core_c += (0.7 * ohm * current_a**2 + between_w) / 235e3
        shell_c += (late_w + 0.02 * abs(power_w) + 0.3 * ohm * current_a**2 - between_w
                    - (9 + 0.4 * v) * (shell_c - air_c)) / 100e3
        soc -= current_a / 3600 / 160
        if s % (2 if drives else 60) == 0:
            rows += [(s, 'Speed', round(3.6 * v), 'km/h'), (s, 'HV battery current', -round(current_a, 1), 'A'),
                     (s, 'HV battery voltage', round(open_v - ohm * current_a, 1), 'V')]
        if s % (6 if drives else 60) == 0:
            read_c = shell_c + RANDOM.gauss(0, 0.1)
            rows += [(s, 'HV battery temperature (max)', round(2 * read_c) / 2, 'degC'),
                     (s, 'SOC HV battery', f'{100 * soc:.1f}', '%'), (s, 'Outside temperature', air_c, 'degC'),
                     (s, 'PTC heater power', heater_w / 1000, 'kW')]
    with open(path, 'w') as log:
        log.write('"SECONDS";"PID";"VALUE";"UNITS"\n')
        log.writelines('"{}";"{}";"{}";"{}"\n'.format(*row) for row in rows)


def write_track(path):
    """Write a drive with a point every 5 s: town with stops, country road, motorway; elevations are off by 2 m."""
    distance_m = speed = 0.0
    with open(path, 'w') as gpx:
        gpx.write('<gpx version="1.1" creator="navigation" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>\n')
        for s in range(1501):
            if s % 5 == 0:
                latitude, longitude = 48.1 + 0.7 * distance_m / 111.2e3, 11.5 + 0.7 * distance_m / 74.3e3
                elevation_m = 520 + 60 * (1 - cos(distance_m * pi / 30e3)) + RANDOM.gauss(0, 2)
                now = datetime(2026, 1, 15, 7) + timedelta(seconds=s)
                gpx.write(f'<trkpt lat="{latitude:.6f}" lon="{longitude:.6f}"><ele>{elevation_m:.1f}</ele>'
                          f'<time>{now.isoformat()}Z</time></trkpt>\n')
            wanted = 0.0 if s < 420 and s % 180 > 140 else (12 if s < 420 else 22 if s < 820 else 30) + sin(s / 40)
            speed += max(-1.0, min(1.0, wanted - speed))
            distance_m += speed
        gpx.write('</trkseg></trk></gpx>\n')


write_log('drive1.csv', 1800, 8.0, 4.0)
write_log('drive2.csv', 1800, 2.0, -1.0)
write_log('drive3.csv', 1800, -4.0, -6.0)
write_log('warm1.csv', 2400, -3.0, -4.0, 700, 2000)
write_log('warm2.csv', 2100, 3.0, 1.0, 300, 1200)
write_log('warm3.csv', 2400, -7.0, -8.0, 0, 1800)
write_log('night.csv', 9 * 3600, 16.0, 2.0, drives=False)
write_track('to_work.gpx')
