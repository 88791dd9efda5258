"""The tip to a marker's centre: looked at, shown, confirmed, driven, measured."""
