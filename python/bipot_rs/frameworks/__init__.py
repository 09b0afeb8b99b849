"""Contact problems as differentiable functions of JAX and PyTorch."""
