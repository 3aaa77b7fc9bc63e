"""What cameras, LiDAR, GNSS and IMU report."""
