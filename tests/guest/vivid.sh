# Three virtual cameras, each with one webcam input: for color, for depth, and one with multi-planar buffers.
load vivid n_devs=3 node_types=0x1,0x1,0x1 num_inputs=1,1,1 input_types=0x0,0x0,0x0 num_outputs=0,0,0 multiplanar=1,1,2
kernel --ignored --test-threads=1 --nocapture vivid::
