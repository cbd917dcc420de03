"""What all tests share: the package is there before NumPy, as in its commands."""

# it keeps linear algebra to one thread, which NumPy reads when it is first imported
import dlolib  # noqa: F401
