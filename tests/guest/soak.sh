# The daemon's cameras and its flash LED, for many shots.
load vivid n_devs=2 node_types=0x1,0x1 num_inputs=1,1 input_types=0x0,0x0 num_outputs=0,0 multiplanar=1,1
load led-class-flash
load v4l2-flash-led-class
load fakeflash
kernel --ignored --test-threads=1 --nocapture endurance::
