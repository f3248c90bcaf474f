"""Speed against accuracy, measured on fixed scenes: time, memory and error of every way to an answer."""
