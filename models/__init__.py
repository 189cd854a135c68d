"""The Python that makes the models: rendered scenes, training, rivals."""
