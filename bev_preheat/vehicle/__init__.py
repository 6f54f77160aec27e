# SPDX-License-Identifier: Apache-2.0
"""The vehicle description and its YAML files."""

from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.loading import load_vehicle, vehicle_contents, vehicle_file, vehicle_fingerprint

__all__ = ['Vehicle', 'load_vehicle', 'vehicle_contents', 'vehicle_file', 'vehicle_fingerprint']
