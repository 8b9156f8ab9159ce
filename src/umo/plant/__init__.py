"""Simulated devices, and the machine in 3D (`plant.twin`). The physics of a station is in the folder of the station."""
