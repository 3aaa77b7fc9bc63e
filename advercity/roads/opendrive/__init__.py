"""OpenDRIVE: its records, its reference lines and lanes, and the SUMO network made of them."""
