// common.h, ioLib.h and ioMan.h of the paper (Listings 1 to 4), as row (b) has them.
// Changed: float is double; names are numbers, since io_enum cannot list 10,000 objects; a table takes
// the place of the switch in Listing 4 (it is the quicker of the two).
#ifndef PAPER_H
#define PAPER_H

typedef enum {ZERO, ONE, ON, OFF, RIGHT, LEFT, UP, DOWN, HIGH, LOW, FRONT, BACK,
              CW, CCW, ENABLE, DISABLE, PASS, FAIL, COMPLETE, INCOMPLETE} binary_enum;
typedef int io_enum;
typedef enum {VOLTS, DEGREES, SAMPLING_PERIODS, MICRONS, COUNTS} units_enum;

// The driver, in a file of its own as in the paper (paper_io.cc), so that nothing of it is inlined.
const int IO_NAMES = 16384;
extern long io_registers[IO_NAMES];
void IO_initialize(io_enum name);
void IO_finalize(io_enum name);
void IO_reset(io_enum name);
long IO_read(io_enum name);
void IO_write(io_enum name, long value);

class binary_actuator {
private:
    bool is_synchronous;
    binary_enum current_command;  // section 4.5: the value last commanded to the hardware
    binary_enum current_value;    // the value last written, sent by update
    binary_enum default_value;
    binary_enum one_name;
    binary_enum zero_name;
public:
    io_enum name;
    binary_actuator(io_enum, bool, binary_enum default_value, binary_enum one_name, binary_enum zero_name);
    ~binary_actuator();
    void reset();
    bool write(binary_enum value);
    bool update();
    binary_enum read();
};

class digital_actuator {
private:
    bool is_synchronous;
    double current_command;
    double current_value;
    double default_value;
    double min_value;
    double max_value;
    double resolution;
    double zero_offset;
public:
    io_enum name;
    units_enum units;
    digital_actuator(io_enum, units_enum, bool, double default_value, double min_value, double max_value,
                     double resolution, double zero_offset);
    ~digital_actuator();
    void reset();
    bool write(double value);
    bool update();
    double read();
};

class binary_sensor {
private:
    bool is_synchronous;
    binary_enum current_value;
    binary_enum one_name;
    binary_enum zero_name;
public:
    io_enum name;
    binary_sensor(io_enum, bool, binary_enum one_name, binary_enum zero_name);
    ~binary_sensor();
    binary_enum read();
    bool sample();
    void reset();
};

class digital_sensor {
private:
    bool is_synchronous;
    double current_value;
    double min_value;
    double max_value;
    double resolution;
    double zero_offset;
public:
    io_enum name;
    units_enum units;
    digital_sensor(io_enum, units_enum, bool, double min_value, double max_value, double resolution,
                   double zero_offset);
    ~digital_sensor();
    double read();
    bool sample();
    void reset();
};
#endif
