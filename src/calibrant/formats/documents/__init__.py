"""Documents of keys and values as data: JSON, YAML, TOML, XML, OpenCV's dialects of them; whatever they describe."""
