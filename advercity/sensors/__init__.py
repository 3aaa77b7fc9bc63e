"""Sensor models: cameras, LiDAR, radar, thermal cameras, GNSS, IMU and the CAN bus."""
