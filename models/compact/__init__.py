"""Two small networks that correct closed forms: how they are built, trained and shipped."""
