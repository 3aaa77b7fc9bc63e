"""The baseline: a small cooperative LiDAR detector. Only this package needs PyTorch."""
