"""A device of torch that computes as the CPU does, in a memory of its own.

Tensors go there by ``.to(PLACE)`` and come back by ``.cpu()``; an operation on tensors of both, or
a look at one from outside (``.numpy()``), is an error, as on a GPU. So a transfer that was
forgotten is found where there is no GPU.
"""

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map

PLACE = "meta"
"""What torch calls it: a name that all builds know."""


class Away(torch.Tensor):
    """A tensor there."""

    @staticmethod
    def __new__(cls, inner):
        return torch.Tensor._make_wrapper_subclass(
            cls, inner.shape, strides=inner.stride(), storage_offset=inner.storage_offset(),
            dtype=inner.dtype, device=PLACE)

    def __init__(self, inner):
        self.inner = inner

    @classmethod
    def __torch_dispatch__(cls, function, types, args=(), kwargs=None):
        return _run(function, args, kwargs or {})


def _run(function, args, kwargs):
    device = kwargs.get("device")
    tensors = [leaf for leaf in tree_leaves((args, kwargs)) if isinstance(leaf, torch.Tensor)]
    there = [isinstance(one, Away) for one in tensors]
    name = str(function)
    moves = name.startswith(("aten._to_copy", "aten.copy_"))
    # A number may lie anywhere, as on a GPU.
    here = [one for one in tensors if not isinstance(one, Away) and one.dim()]
    if any(there) and here and not moves:
        raise RuntimeError(f"{name}: tensors of two devices")
    kwargs = {key: value for key, value in kwargs.items() if key != "device"}
    if device is not None:
        kwargs["device"] = "cpu"
    found = function(*tree_map(_inner, args), **tree_map(_inner, kwargs))
    away = torch.device(device).type == PLACE if device is not None else any(there)
    if name.startswith("aten.copy_"):
        return args[0]
    if not away:
        return found
    changed = [arg for arg in args if isinstance(arg, Away)]

    def wrapped(value):
        # What works in place gives its own argument back.
        own = next((arg for arg in changed if arg.inner is value), None)
        return own if own is not None else Away(value) if isinstance(value, torch.Tensor) else value

    return tree_map(wrapped, found)


def _inner(value):
    return value.inner if isinstance(value, Away) else value


class OtherMemory(TorchDispatchMode):
    """While this is entered, `PLACE` is such a device."""

    @classmethod
    def _should_skip_dynamo(cls):
        # Else torch's compiler, which is given nothing here, is imported, for seconds.
        return False

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        return _run(function, args, kwargs or {})
