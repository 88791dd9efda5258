"""What commands read of a bag: pictures as files of photos, poses as a file of poses."""
