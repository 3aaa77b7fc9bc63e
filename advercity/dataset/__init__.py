"""OPV2V datasets: annotation, files, manifest."""
