"""The networks of Qiu et al. 2020, as published, trained on our own renders."""
