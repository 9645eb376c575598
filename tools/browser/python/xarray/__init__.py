"""As much of xarray as the explorer's answers need: named arrays with their dims, in one table."""

from __future__ import annotations

import numpy as np


class DataArray:
    """An array with names of its axes."""

    def __init__(self, dims, values, attrs=None):
        words = isinstance(values, (list, tuple)) and any(isinstance(one, str) for one in values)
        self.dims, self.values = (
            (dims,) if isinstance(dims, str) else tuple(dims),
            values if words else np.asarray(values),
        )
        self.attrs = dict(attrs or {})

    @property
    def shape(self):
        return self.values.shape

    def __getitem__(self, key):
        return DataArray((), self.values[key])

    def __float__(self):
        return float(self.values)

    def __truediv__(self, other):
        return DataArray(self.dims, self.values / getattr(other, "values", other))

    def __rmul__(self, other):
        return DataArray(self.dims, other * self.values)

    def clip(self, min):
        return DataArray(self.dims, np.maximum(self.values, min))

    def isel(self, at):
        if any(isinstance(one, list) for one in at.values()) and len(self.dims) != 1:
            raise NotImplementedError("several numbers along one of many dims")
        if isinstance(self.values, (list, tuple)):  # of words, along one dim
            return DataArray(self.dims, self.values[at.get(self.dims[0], slice(None))], self.attrs)
        dims = tuple(dim for dim in self.dims if not isinstance(at.get(dim), int))
        return DataArray(dims, self.values[tuple(at.get(dim, slice(None)) for dim in self.dims)], self.attrs)


class Dataset:
    """Arrays by name; coordinates are arrays like all others here."""

    def __init__(self, data=None, coords=None, attrs=None):
        self.attrs, self.variables = dict(attrs or {}), {}
        for name, one in {**(data or {}), **(coords or {})}.items():
            self[name] = one

    @property
    def data_vars(self):
        return self.variables

    @property
    def dims(self):
        return {dim for one in self.variables.values() for dim in one.dims}

    def __setitem__(self, name, one):
        self.variables[name] = one if isinstance(one, DataArray) else DataArray(*one)

    def __getitem__(self, name):
        if isinstance(name, list):
            return Dataset({one: self.variables[one] for one in name}, attrs=self.attrs)
        return self.variables[name]

    def __contains__(self, name):
        return name in self.variables

    def isel(self, at=None, **more):
        at = {**(at or {}), **more}
        return Dataset({name: one.isel(at) for name, one in self.variables.items()}, attrs=self.attrs)

    def assign(self, more):
        return Dataset({**self.variables, **more}, attrs=self.attrs)

    def assign_attrs(self, *given, **more):
        return Dataset(self.variables, attrs={**self.attrs, **dict(*given), **more})


Variable = DataArray
