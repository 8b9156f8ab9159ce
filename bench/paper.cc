// Row (b): the paper's own design. The four classes of Listings 2 and 3, the compound objects of Figure 4 in the manner
// of Listing 6 (pointers to their components, whose functions of the same name they call), the numbers of Listing 5.
// Classes and compounds stand in one file: the compiler may inline all but the driver, which is more than the paper's
// division into files would allow.
#include "paper.h"

#include <cmath>
#include <vector>

// ---- Listing 2 ------------------------------------------------------------------------------------------------------

binary_actuator::binary_actuator(io_enum n, bool synchronous, binary_enum d, binary_enum one, binary_enum zero)
    : is_synchronous(synchronous), current_command(d), current_value(d), default_value(d), one_name(one),
      zero_name(zero), name(n) { IO_initialize(name); }
binary_actuator::~binary_actuator() { IO_finalize(name); }
void binary_actuator::reset() { current_value = default_value; IO_reset(name); current_command = default_value; }
binary_enum binary_actuator::read() { return current_command; }

bool binary_actuator::write(binary_enum value)
{
    if (value != one_name && value != zero_name)
        return false;
    current_value = value;
    if (!is_synchronous) {
        IO_write(name, current_value == one_name ? 1 : 0);
        current_command = current_value;
    }
    return true;
}

bool binary_actuator::update()
{
    if (is_synchronous) {
        IO_write(name, current_value == one_name ? 1 : 0);
        current_command = current_value;
    }
    return true;
}

digital_actuator::digital_actuator(io_enum n, units_enum u, bool synchronous, double d, double low, double high,
                                   double step, double zero)
    : is_synchronous(synchronous), current_command(d), current_value(d), default_value(d), min_value(low),
      max_value(high), resolution(step), zero_offset(zero), name(n), units(u) { IO_initialize(name); }
digital_actuator::~digital_actuator() { IO_finalize(name); }
void digital_actuator::reset() { current_value = default_value; IO_reset(name); current_command = default_value; }
double digital_actuator::read() { return current_command; }

bool digital_actuator::write(double value)
{
    if (!(min_value <= value && value <= max_value))
        return false;
    current_value = value;
    if (!is_synchronous) {
        IO_write(name, std::lrint((current_value - zero_offset) / resolution));
        current_command = current_value;
    }
    return true;
}

bool digital_actuator::update()
{
    if (is_synchronous) {
        IO_write(name, std::lrint((current_value - zero_offset) / resolution));
        current_command = current_value;
    }
    return true;
}

// ---- Listing 3 ------------------------------------------------------------------------------------------------------

binary_sensor::binary_sensor(io_enum n, bool synchronous, binary_enum one, binary_enum zero)
    : is_synchronous(synchronous), current_value(zero), one_name(one), zero_name(zero), name(n) { IO_initialize(name); }
binary_sensor::~binary_sensor() { IO_finalize(name); }
void binary_sensor::reset() { IO_reset(name); }

binary_enum binary_sensor::read()
{
    if (!is_synchronous)
        current_value = IO_read(name) ? one_name : zero_name;
    return current_value;
}

bool binary_sensor::sample()
{
    if (is_synchronous)
        current_value = IO_read(name) ? one_name : zero_name;
    return true;
}

digital_sensor::digital_sensor(io_enum n, units_enum u, bool synchronous, double low, double high, double step,
                               double zero)
    : is_synchronous(synchronous), current_value(0.0), min_value(low), max_value(high), resolution(step),
      zero_offset(zero), name(n), units(u) { IO_initialize(name); }
digital_sensor::~digital_sensor() { IO_finalize(name); }
void digital_sensor::reset() { IO_reset(name); }

double digital_sensor::read()
{
    if (!is_synchronous)
        current_value = IO_read(name) * resolution + zero_offset;
    return current_value;
}

bool digital_sensor::sample()
{
    if (is_synchronous)
        current_value = IO_read(name) * resolution + zero_offset;
    return min_value <= current_value && current_value <= max_value;
}

// ---- Listings 5 and 6: the compound objects -------------------------------------------------------------------------

struct dfdf_config {
    digital_actuator *motor; digital_sensor *encoder; binary_actuator *zero;
    void update() { motor->update(); zero->update(); }
    void sample() { encoder->sample(); }
};

struct bdfd_config1 {
    binary_actuator *step; binary_actuator *direction; digital_sensor *encoder; binary_actuator *zero;
    void update() { step->update(); direction->update(); zero->update(); }
    void sample() { encoder->sample(); }
};

struct bdfd_config2 {
    binary_actuator *feedforward_device; digital_sensor *feedback_device;
    void update() { feedforward_device->update(); }
    void sample() { feedback_device->sample(); }
};

struct bfbf_config {
    binary_actuator *feedforward_device; binary_sensor *feedback_device;
    void update() { feedforward_device->update(); }
    void sample() { feedback_device->sample(); }
};

struct manipulator {
    dfdf_config *z; bdfd_config1 *theta; bdfd_config2 *counterweight; bfbf_config *gripper;
    binary_actuator *solenoid; digital_sensor *counter;
    void update() { z->update(); theta->update(); counterweight->update(); gripper->update(); solenoid->update(); }
    void sample() { z->sample(); theta->sample(); counterweight->sample(); gripper->sample(); counter->sample(); }
};

// All manipulators; the last one may lack groups (null pointers), which is looked at once a period. For the bench's own
// use the lists hold every actuator and sensor in declared order. The program runs once: nothing is deleted.
struct plant {
    std::vector<manipulator *> whole;
    manipulator rest = {};
    std::vector<digital_actuator *> digital_actuators;
    std::vector<binary_actuator *> binary_actuators;
    std::vector<double> volts;
    std::vector<binary_enum> states;
    std::vector<binary_enum> one_names, zero_names;
    std::vector<digital_sensor *> digital_sensors;
    std::vector<binary_sensor *> binary_sensors;
    std::vector<io_enum> inputs, outputs;  // names in declared order
    io_enum next = 0;

    digital_sensor *sensor(units_enum units, double low, double high, double step, double zero)
    {
        inputs.push_back(next);
        digital_sensors.push_back(new digital_sensor(next++, units, true, low, high, step, zero));
        return digital_sensors.back();
    }

    binary_actuator *valve(binary_enum d, binary_enum one, binary_enum zero)
    {
        outputs.push_back(next);
        one_names.push_back(one);
        zero_names.push_back(zero);
        binary_actuators.push_back(new binary_actuator(next++, true, d, one, zero));
        return binary_actuators.back();
    }

    digital_actuator *motor()
    {
        outputs.push_back(next);
        digital_actuators.push_back(new digital_actuator(next++, VOLTS, true, 0.0, -10.0, 10.0, 10.0 / 2047.0, 0.0));
        return digital_actuators.back();
    }

    binary_sensor *gripper_pressure()
    {
        inputs.push_back(next);
        binary_sensors.push_back(new binary_sensor(next++, true, FAIL, PASS));
        return binary_sensors.back();
    }

    void build(manipulator &m, int objects)  // as many groups as make up that many objects
    {
        const int end = next + objects;
        if (next < end) {
            digital_actuator *drive = motor();
            digital_sensor *encoder = sensor(MICRONS, 55000.0, 129000.0, 4.64357, -147871.0);
            m.z = new dfdf_config{drive, encoder, valve(DISABLE, ENABLE, DISABLE)};
        }
        if (next < end) {
            binary_actuator *step = valve(DOWN, UP, DOWN), *direction = valve(CW, CW, CCW);
            digital_sensor *encoder = sensor(DEGREES, -270.0, 270.0, 0.000529483, 227.4438);
            m.theta = new bdfd_config1{step, direction, encoder, valve(DISABLE, ENABLE, DISABLE)};
        }
        if (next < end) {
            binary_actuator *vacuum = valve(OFF, ON, OFF);
            m.counterweight = new bdfd_config2{vacuum, sensor(COUNTS, 0.0, 1000.0, 1.0, 0.0)};
        }
        if (next < end) {
            binary_actuator *vacuum = valve(OFF, ON, OFF);
            m.gripper = new bfbf_config{vacuum, gripper_pressure()};
        }
        if (next < end)
            m.solenoid = valve(OFF, ON, OFF);
        if (next < end)
            m.counter = sensor(COUNTS, 0.0, 99999.9, 1.0, 0.0);
    }

    void sample()
    {
        for (manipulator *m : whole) m->sample();
        if (rest.z) rest.z->sample();
        if (rest.theta) rest.theta->sample();
        if (rest.counterweight) rest.counterweight->sample();
        if (rest.gripper) rest.gripper->sample();
    }

    void update()
    {
        for (manipulator *m : whole) m->update();
        if (rest.z) rest.z->update();
        if (rest.theta) rest.theta->update();
        if (rest.counterweight) rest.counterweight->update();
        if (rest.gripper) rest.gripper->update();
        if (rest.solenoid) rest.solenoid->update();
    }

    void write()
    {
        for (size_t i = 0; i < digital_actuators.size(); i++) digital_actuators[i]->write(volts[i]);
        for (size_t i = 0; i < binary_actuators.size(); i++) binary_actuators[i]->write(states[i]);
    }
};

// ---- What the bench calls; periods are repeated here, so that the call itself does not count -------------------------

#define BENCH extern "C" __attribute__((visibility("default")))

BENCH plant *paper_new(int objects)
{
    if (objects > IO_NAMES)
        return nullptr;
    plant *p = new plant;
    for (; objects >= 13; objects -= 13) {
        p->whole.push_back(new manipulator{});
        p->build(*p->whole.back(), 13);
    }
    p->build(p->rest, objects);
    return p;
}

BENCH void paper_prepare(plant *p, const double *commands)  // in declared order, one volt among seven levels
{
    for (size_t i = 0, binary = 0; i < p->outputs.size(); i++) {
        if (i % 8 == 0) {
            p->volts.push_back(commands[i]);
        } else {
            p->states.push_back(commands[i] != 0.0 ? p->one_names[binary] : p->zero_names[binary]);
            binary++;
        }
    }
}

BENCH void paper_load(plant *p, const long *raws)
{
    for (size_t i = 0; i < p->inputs.size(); i++) io_registers[p->inputs[i]] = raws[i];
}

BENCH void paper_store(plant *p, long *raws)
{
    for (size_t i = 0; i < p->outputs.size(); i++) raws[i] = io_registers[p->outputs[i]];
}

BENCH void paper_values(plant *p, double *values)
{
    size_t digital = 0, binary = 0;
    for (size_t i = 0; i < p->inputs.size(); i++)
        values[i] = i % 5 == 3 ? (p->binary_sensors[binary++]->read() == FAIL) : p->digital_sensors[digital++]->read();
}

BENCH void paper_sample_update(plant *p, int periods)
{
    for (int i = 0; i < periods; i++) { p->sample(); p->update(); }
}

BENCH void paper_write(plant *p, int periods)
{
    for (int i = 0; i < periods; i++) { p->write(); asm volatile("" ::: "memory"); }
}

BENCH void paper_period(plant *p, int periods)
{
    for (int i = 0; i < periods; i++) { p->sample(); p->write(); p->update(); }
}
