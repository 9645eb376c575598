"""Series of measured files of one sample: regions, contrasts, and what explains them when hardly anything is known."""
