"""One contact with an anisotropic compliance that slips: case A14, to eight digits."""

# W, r and v for q = (-1, 1.6, 0.9) and a coefficient of 0.4.
ANISOTROPIC_SLIP = [
    (
        [[1.0, 0, 0], [0, 2, 0], [0, 0, 5]],
        [1, -0.38002548, -0.12482241],
        [0, 0.83994904, 0.27588797],
    ),
    (
        [[1.0, 0.2, -0.1], [0.2, 2, 0.5], [-0.1, 0.5, 5]],
        [1.07652377, -0.42297689, -0.08071613],
        [0, 0.92899290, 0.17727851],
    ),
]
