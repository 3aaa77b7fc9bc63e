"""Evaluation of detectors on datasets: predictions of any model against the annotations."""
