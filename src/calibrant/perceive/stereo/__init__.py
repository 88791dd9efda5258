"""What two calibrated cameras see together: points, rectified pictures, depth, epipolar lines."""
