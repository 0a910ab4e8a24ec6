"""Loss and gradient of the Van der Pol PINC net in TensorFlow, formulated as the authors' program is:
the full batch, dy/dt of each state by a gradient tape inside that of the loss, compiled to a graph.

    python tensorflow_loss_gradient.py evaluation.safetensors
"""

import os

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
os.environ.setdefault("CUDA_VISIBLE_DEVICES", "")

import statistics
import sys
import time

import tensorflow as tf

import evaluation as ev


def authors(e):
    """A function that gives loss and gradient, compiled."""
    number = lambda array: tf.constant(array, tf.float64)
    weights = [tf.Variable(w.T, dtype=tf.float64) for w in e.weights]
    biases = [tf.Variable(b, dtype=tf.float64) for b in e.biases]
    collocation, initial = number(e.collocation), number(e.initial)
    variables = [variable for pair in zip(weights, biases) for variable in pair]

    def net(points):
        a = (points - number(e.input_mean)) / number(e.input_std)
        for w, b in zip(weights[:-1], biases[:-1]):
            a = tf.tanh(a @ w + b)
        y = a @ weights[-1] + biases[-1]
        return y * number(e.output_std) + number(e.output_mean)

    @tf.function
    def loss_gradient(collocation, initial):
        with tf.GradientTape() as tape:
            t = collocation[:, :1]
            with tf.GradientTape(persistent=True) as inner:
                inner.watch(t)
                y = net(tf.concat([t, collocation[:, 1:]], axis=1))
                y1, y2 = y[:, :1], y[:, 1:]
            u = collocation[:, 3:]
            f1 = inner.gradient(y1, t) - y2
            f2 = inner.gradient(y2, t) - ((1.0 - y1 * y1) * y2 - y1 + u)
            residual = tf.concat([f1, f2], axis=1) * number(e.residual_scale)
            error = (net(initial) - initial[:, 1:3]) * number(e.initial_scale)
            physics = e.physics_factor * tf.reduce_sum(residual**2)
            loss = physics + e.initial_factor * tf.reduce_sum(error**2)
        return loss, tape.gradient(loss, variables)

    return lambda: loss_gradient(collocation, initial)


def as_pairs(gradient):
    """Weights as [out, in], with their biases."""
    return [(w.numpy().T, b.numpy()) for w, b in zip(gradient[::2], gradient[1::2])]


def main():
    evaluation = ev.read(sys.argv[1])
    work = authors(evaluation)
    loss, gradient = work()
    error = ev.check(evaluation, "tensorflow", loss, as_pairs(gradient))
    times = []
    for _ in range(9):
        clock = time.perf_counter()
        work()[0].numpy()
        times.append(time.perf_counter() - clock)
    median = 1e3 * statistics.median(times)
    print(f"tensorflow  {median:8.1f} ms   differs from pinc by {error:.0e}")


if __name__ == "__main__":
    main()
